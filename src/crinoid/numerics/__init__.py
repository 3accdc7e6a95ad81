"""Numerics without physics: banded matrices, frames, piecewise polynomials, spectra.

May import ``foundation`` and lower folders.
"""
