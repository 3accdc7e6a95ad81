"""Inverse problems: tuned gains, identified and optimised parameters.

May import ``analysis`` and lower folders.
"""

TUNING = "tune.nc"  # name of the file of a tuning
IDENTIFICATION = "identify.nc"  # name of the file of an identification
OPTIMISATION = "optimise.nc"  # name of the file of an optimisation

ESTIMATE = "estimate.nc"  # name of the file of an estimate


class StoppedError(Exception):
    """The user stopped a search."""
