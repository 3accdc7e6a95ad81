"""The same arm in other programs: each lets it go from rest.

May import ``crinoid.scenario``.
"""
