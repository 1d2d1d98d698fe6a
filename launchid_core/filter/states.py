"""State of the innovations form: x, its covariance, sensitivities, and what runs beside them (`predictor`)."""

N_STATES = 4    # of the vehicle
N_CHANNELS = 3  # theta, theta_dot, beta
N_TESTS = 4     # slopes of a6 and k1; what no model has: an acceleration that stays, an offset of the gyro
SLOPE_A6, SLOPE_K1, MOMENT_TEST, GYRO_TEST = range(4)
N_SLOPES = 2
MAX_DELAY_SAMPLES = 64

# time (f8)
LAST, RUNNING, FIRST = range(3)  # stamp of the last sample [s]; 1 if there was one in this segment; the first of all
N_TIME = 3

# note (i8): what the filter did of its own accord since the start
OUTLIERS, RESTARTS, LEVEL_CLAMPS, SEGMENTS, WITHDRAWN_CHANGES = range(5)
N_NOTES = 5

# path (f8): flight-path angle at the last stamp [rad]
GAMMA_NOW = 0

# process noise (index of the command's and the acceleration's levels)
COMMAND_NOISE, ACCELERATION_NOISE = 3, 4


