"""Fit the equation in its weak form: increments of theta_dot on integrals of the terms, weighted by the noise."""
