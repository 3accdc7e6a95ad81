"""The version of crinoid."""

__version__ = "0.1.0"
