"""What is known of the measured logs, from their authors or from weak-form regressions before any diagnosis.

`main`: the defect of the nominal, as groups of names; one of each group must be named.  `beside`: names that are right
too.  Any other name is wrong.  `part`: "judge": nothing is chosen on it.
"""

from dataclasses import dataclass

Range = tuple[float, float]

TRIM = ("attitude_bias", "steady_wind", "thrust_misalignment", "nozzle_sensor_bias", "actuator_bias", "gyro_bias",
        "moment_step", "wind_walk", "turbulence")
DELAY = ("actuator_delay", "actuator_bandwidth", "gyro_delay", "attitude_delay")


@dataclass(frozen=True)
class Known:
    """A log, its nominal, and what a right answer is."""

    nominal: str
    words: str
    main: tuple[tuple[str, ...], ...]
    beside: tuple[str, ...] = ()
    terms: tuple[str, ...] = ()        # that `missing_term` may have; (): any
    command: bool = False              # the column beta is a command: a delay of it can be found
    library: str = "rigid-body"        # of identify
    a6: Range | None = None            # coefficients of theta and beta of that library
    k1: Range | None = None
    part: str = "open"


PENDULUM = Known("pendulum_linear", "sin(theta) in the place of theta; friction; the torque gain is not decided",
                 (("missing_term",),), ("friction", "control_effectiveness", "actuator_gain", "aero_instability"),
                 ("sin(theta)", "theta", "sign(theta_dot)"))
SERVO = Known("servo_xl330", "rate damping 6 1/s; friction 1.9 rad/s^2; speed filtered: gyro_delay 20 ms, scale 0.96",
              (("aero_damping",),), ("friction", "gyro_delay", "gyro_scale"), ("theta_dot", "sign(theta_dot)"), True,
              "sin(theta),beta")
DROP = Known("servo_xl330", "friction and damping, a small rest angle; after 2 s no k1",
             (("friction", "aero_damping"),), ("friction", "aero_damping", "gyro_delay", "gyro_scale", *TRIM),
             ("theta_dot", "sign(theta_dot)", "1"), True, "sin(theta),beta", part="judge")
TAIL_SITTER = Known("tailsitter_roll", "delay about 50 ms; R2 0.63 -> 0.76 and 0.52 -> 0.67", (("actuator_delay",),),
                    ("actuator_bandwidth", *TRIM), ("1",), True, k1=(85.0, 100.0))

KNOWN = {
    "dfki_pendulum_dircol": PENDULUM,
    "dfki_pendulum_ddp": PENDULUM,
    "bam_xl330_kp200_sin_time_square": SERVO,
    "bam_xl330_kp400_sin_time_square": SERVO,
    "bam_xl330_kp400_lift_and_drop": DROP,
    "map_single_free": Known("single_pendulum_linear", "sin(theta) in the place of theta; damping 0.07 1/s; no k1",
                             (("missing_term",),), ("aero_damping", "friction", "aero_cubic", "aero_instability"),
                             ("sin(theta)", "theta", "theta^3", "theta_dot"), library="sin(theta),beta"),
    # fetched by hand (real_fetched.py), never part of this project
    "mcar_8_3_1": Known("balancing_robot", "trim -0.055 rad and a delay of 10..12 ms; R2 0.858, 0.923 trim, 0.995 both",
                        (TRIM, DELAY), (), ("1",), True, a6=(85.0, 107.0)),
    "psas_roll": Known("sounding_rocket_roll", "delay 20..40 ms, an offset that drifts; only a gyro",
                       (("actuator_delay",),), ("actuator_bandwidth", "gyro_delay", *TRIM), ("1",), True),
    "ubc_tvc": Known("hobby_rocket_tvc", "commands held about 105 ms; k1 about 51", (("actuator_delay",),),
                     ("actuator_bandwidth", "gyro_delay", *TRIM), ("1",), True, k1=(41.0, 61.0)),
    "tailsitter_stabilized_1": TAIL_SITTER,
    "tailsitter_step_size3_1": TAIL_SITTER,
    "aeropendulum_aprbs_1": Known("aeropendulum", "delay 80..120 ms and thrust as the square of the input; R2 0.776, "
                                  "0.878 delay, 0.841 square, 0.956 both",
                                  (("actuator_delay",), ("missing_term",)), ("actuator_bandwidth", *TRIM),
                                  ("beta^2", "1"), True, part="judge"),
}
