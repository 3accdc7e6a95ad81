"""Basics without physics: names of axes, status of a run, result variables, atomic files.

Imports no other folder.
"""
