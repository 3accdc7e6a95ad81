"""Numbers of a scenario found from a recorded motion.

Importing it costs nothing: what computes is in `crinoid.identification.identification`.
"""

IDENTIFICATION = "identify.nc"
"""Name of the file that what was found is saved in."""
