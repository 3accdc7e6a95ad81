"""Many runs: batches, sweeps, comparisons of controllers.

May import ``analysis`` and lower folders.
"""
