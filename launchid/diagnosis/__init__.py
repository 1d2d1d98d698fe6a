"""The diagnosis: where simulation and measurement part, why, and what the model should be instead (README.md)."""
