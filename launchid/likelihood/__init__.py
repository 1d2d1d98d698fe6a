"""The likelihood of a log under a vehicle's model: one Kalman filter, one estimate, one fit of noise levels."""
