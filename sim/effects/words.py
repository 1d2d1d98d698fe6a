"""What each cause does, in an equation: u is the command on its way to the actuator, b the true nozzle angle, z_ the
measured signals."""

MEANING = {
    "control_effectiveness": "k1 -> scale*k1",
    "control_loss": "k1 -> (1 - fraction)*k1 from `time` on",
    "control_slope": "k1 -> k1*(1 + slope*(t - t_middle)), t_middle the middle of the flight",
    "aero_instability": "a6 -> scale*a6",
    "aero_damping": "theta_ddot -= coefficient*theta_dot",
    "aero_cubic": "a6*theta -> a6*(theta + coefficient*theta^3)",
    "friction": "theta_ddot -= coefficient*sign(theta_dot)",
    "thrust_misalignment": "k1*b -> k1*(b + angle)",
    "moment_step": "theta_ddot += acceleration from `time` on",
    "nozzle_inertia": "theta_ddot += coefficient*beta_ddot",
    "lateral_drift": "gamma_dot = z_alpha*alpha + z_beta*(b + m)",
    "slosh": "psi'' + 2 z w psi' + w^2 psi = -theta_ddot; theta_ddot += coupling*w^2*psi",
    "bending": "eta'' + 2 z w eta' + w^2 eta = gain*w^2*b; z_theta += eta, z_theta_dot += eta'",
    "missing_term": "theta_ddot += coefficient*term, a library term",
    "gust": "a6*theta -> a6*(theta + angle*(1 - cos(2 pi (t - time)/duration))/2) while it lasts",
    "steady_wind": "a6*theta -> a6*(theta + angle)",
    "turbulence": "a6*theta -> a6*(theta + w), w stationary and of first order with `level` and `time_constant`",
    "wind_walk": "a6*theta -> a6*(theta + w), w a random walk of `level`",
    "periodic_disturbance": "theta_ddot += amplitude*sin(frequency*t + phase)",
    "actuator_delay": "u(t) -> u(t - delay), added to the nominal's",
    "actuator_bandwidth": "natural frequency (or 1/time constant) -> scale*it; `lag` = 1: as slow by a first-order lag "
                          "before the servo instead",
    "actuator_gain": "u -> scale*u",
    "actuator_rate_limit": "abs(b') <= rate; `wind_up`: the rate asked for may run ahead of the limit by so much of it "
                           "(a first-order servo has none)",
    "actuator_backlash": "play of +-half_width on u",
    "actuator_bias": "u -> u + angle",
    "attitude_bias": "on z_theta, seen by the controller too",
    "attitude_delay": "on z_theta, seen by the controller too",
    "gyro_bias": "on z_theta_dot",
    "gyro_scale": "on z_theta_dot",
    "gyro_delay": "on z_theta_dot",
    "nozzle_sensor_bias": "on z_beta",
    "controller_mismatch": "the logged command is not the nominal controller's",
}
