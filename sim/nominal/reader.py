"""A nominal out of the table of its file."""

from ..errors import InputError
from ..sections import Controller, Diagnosis, Nominal, Offsets, Sensors, Simulation
from .control import actuator_of, controller_of, guidance_of, test_input_of
from .plant import drift_of, effects_of, uncertainty_of, vehicle_of, wind_of
from .table import Table


def nominal_of(file: Table) -> Nominal:
    """All sections, checked; InputError naming the place of whatever is wrong."""
    known = {"name", "vehicle", "uncertainty", "actuator", "controller", "guidance", "sensors", "simulation",
             "diagnosis", "test_input", "drift", "wind", "offsets", "effects"}
    for key in file.table:
        if key not in known:
            raise InputError(f"{file.path}: unknown key '{key}'; expected one of {', '.join(sorted(known))}")
    name = file.table.get("name", file.path.stem)
    if not isinstance(name, str):
        raise file.fail("name", name, "a text")
    for section in ("vehicle", "sensors"):
        if section not in file.table:
            raise InputError(f"{file.path}: section [{section}] is missing; every nominal needs it")
    simulation = file.section("simulation", Simulation)
    diagnosis = file.section("diagnosis", Diagnosis)
    controller = controller_of(file)
    sensors = file.section("sensors", Sensors)
    assert sensors is not None
    if simulation is not None:
        whole_steps(file, simulation, controller, sensors)
    vehicle, terms = vehicle_of(file)
    return Nominal(
        name=name, vehicle=vehicle, terms=terms, sensors=sensors, uncertainty=uncertainty_of(file),
        actuator=actuator_of(file), controller=controller, guidance=guidance_of(file, controller),
        simulation=simulation, diagnosis=diagnosis or Diagnosis(), test_input=test_input_of(file),
        drift=drift_of(file), wind=wind_of(file),
        offsets=file.section("offsets", Offsets), effects=effects_of(file), path=str(file.path))


def whole_steps(file: Table, simulation: Simulation, controller: Controller | None, sensors: Sensors) -> None:
    """The controller's and the sensors' periods must be whole numbers of integration steps."""
    periods = {"sensors.period": sensors.period}
    if controller is not None:
        periods["controller.period"] = controller.period
    for place, period in periods.items():
        steps = period / simulation.step
        if round(steps) < 1 or abs(steps - round(steps)) > 1e-6:
            raise file.fail(place, period, f"a whole number of simulation steps ({simulation.step} s)")
