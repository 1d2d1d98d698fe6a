"""Monte Carlo campaigns of drawn vehicles, and the proof of requirements."""
