"""What a run leaves behind: dataset, scene, measures, tables.

May import ``assembly`` and ``tables`` and lower folders.
"""
