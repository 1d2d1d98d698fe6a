"""The search for the causes that the log needs."""
