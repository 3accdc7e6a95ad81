"""Results of a run: record, file, metrics.

May import ``assembly`` and ``tables`` and lower folders.
"""
