"""Diagnostics: plausible values, notes on a run, control loop, energy balance.

May import ``results`` and lower folders.
"""
