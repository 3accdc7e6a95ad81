"""Validation: cases with a known answer, which crinoid computes and compares.

May import all of crinoid.
"""
