"""Analyses without a run: linear loop, stability margins, modes, statistics of a current.

May import ``simulation`` and lower folders.
"""
