"""Basics: names of axes, status of a run, result variables, atomic files, fixed numbers.

Imports no other folder.
"""
