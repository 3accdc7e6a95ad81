"""Benchmarks: times of steps, runs and commands, next to other programs.

May import all of crinoid, and ``validation``.
"""
