"""Benchmarks: times of steps, runs and commands, next to other programs.

May import ``learning`` and lower folders.
"""
