"""Compiles what most tests need, a half of it: python tests/warm.py 0 or 1.

Both of pytest's workers would else compile all of it at the same time.
"""

import sys
from dataclasses import replace

from launchid.bound.flights import flight_bound
from launchid.diagnosis.verdict import diagnose
from launchid.identification.windows import onboard_model
from launchid.log.log import flown_log
from launchid_core import Config, Estimator
from sim.flight import fly_whole
from sim.nominal import Nominal, load_nominal


def short() -> Nominal:
    """A nominal whose flights last 4 s."""
    nominal = load_nominal("constant")
    assert nominal.simulation is not None
    return replace(nominal, simulation=replace(nominal.simulation, duration=4.0))


def compile_filtered() -> None:
    """The filtered formulation, which is most of the core, and its bound."""
    nominal = short()
    Estimator(Config(formulation="filtered", model=onboard_model(nominal, 0.01)))
    flight_bound(nominal, 1.0)


def compile_others() -> None:
    """The regression, the simulator, the diagnosis."""
    Estimator(Config(formulation="integral"))
    nominal = short()
    diagnose(flown_log(fly_whole(nominal, 1)), nominal)


if __name__ == "__main__":
    (compile_filtered, compile_others)[int(sys.argv[1])]()
