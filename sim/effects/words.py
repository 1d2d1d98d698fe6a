"""The equation of each cause as text: u is the command on its way to the actuator, b the true nozzle angle, z_ the
measured signals."""

MEANING = {
    "control_effectiveness": "k1 -> scale*k1",
    "control_loss": "k1 -> (1 - fraction)*k1 from `time` on",
    "control_slope": "k1 -> k1*(1 + slope*(t - middle)); `middle` inf or left out: the centre of the log, of "
        "the flight in `simulate`",
    "aero_instability": "a6 -> scale*a6",
    "aero_damping": "theta_ddot -= coefficient*theta_dot",
    "aero_cubic": "a6*theta -> a6*(theta + coefficient*theta^3)",
    "friction": "theta_ddot -= coefficient*sign(theta_dot)",
    "thrust_misalignment": "k1*b -> k1*(b + angle)",
    "moment_step": "theta_ddot += acceleration from `time` on",
    "nozzle_inertia": "theta_ddot += coefficient*b'' (tail wags dog; of a launcher below 0), b'' the "
        "nozzle's own, rate limit and all",
    "lateral_drift": "added to those of `[drift]`, which need not be there; the column `gamma` is the "
        "nominal's affair and is written with `[drift]` only",
    "slosh": "psi'' + 2 z w psi' + w^2 psi = -theta_ddot; theta_ddot += coupling*w^2*psi",
    "bending": "eta'' + 2 z w eta' + w^2 eta = gain*w^2*b; z_theta += eta, z_theta_dot += eta'",
    "missing_term": "theta_ddot += coefficient*term, a library term",
    "gust": "a6*theta -> a6*(theta + angle*(1 - cos(2 pi (t - time)/duration))/2) while it lasts",
    "steady_wind": "a6*theta -> a6*(theta + angle)",
    "turbulence": "the wind of `[wind]` `turbulence`, beside the nominal's; drawn from the seed",
    "wind_walk": "the wind of `[wind]` `walk`, from 0 at t = 0, beside the nominal's; drawn from the seed",
    "periodic_disturbance": "theta_ddot += amplitude*sin(frequency*t + phase)",
    "actuator_delay": "u(t) -> u(t - delay), added to the nominal's",
    "actuator_bandwidth": "natural frequency (or 1/time constant) -> scale*it; `lag` = 1: as slow by a first-order lag "
                          "before the servo instead",
    "actuator_gain": "u -> scale*u",
    "actuator_rate_limit": "abs(b') <= rate; `wind_up`: the commanded rate may exceed the limit by this share of it "
                           "(a first-order servo has none)",
    "actuator_backlash": "backlash of half_width each way on u",
    "actuator_bias": "u -> u + angle",
    "input_washout": "u -> u - w, time_constant*w' = u - w from w(0) = 0: u less its slow part (a motor's back-EMF)",
    "attitude_bias": "on z_theta, seen by the controller too",
    "attitude_delay": "on z_theta, seen by the controller too",
    "gyro_bias": "on z_theta_dot",
    "gyro_scale": "on z_theta_dot",
    "gyro_delay": "on z_theta_dot",
    "nozzle_sensor_bias": "on z_beta",
    "controller_mismatch": "the logged command is not the nominal controller's",
}
