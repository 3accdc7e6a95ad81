"""Inverse problems: tuned gains, identified parameters.

May import ``analysis`` and lower folders.
"""

TUNING = "tune.nc"
"""Name of the file of a tuning."""
IDENTIFICATION = "identify.nc"
"""Name of the file of an identification."""


class StoppedError(Exception):
    """The user stopped a search."""
