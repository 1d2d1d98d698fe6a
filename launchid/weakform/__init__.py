"""The equation in its weak form: increments of theta_dot against integrals of the terms, weighted by the noise."""
