"""Gains found by gradient through the closed loop.

Importing it costs nothing: what computes is in `crinoid.tuning.tuning`.
"""

TUNING = "tune.nc"
"""Name of the file that a search is saved in."""
