"""Monte Carlo campaigns of vehicles drawn at random, and the statistical proof of requirements."""
