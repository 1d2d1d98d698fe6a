"""The version, in a module of its own: what is saved bears it."""

VERSION = "0.3.0"
