"""The diagnosis: estimate everything plausible, take away what left-out rows do not need (README.md has the method)."""
