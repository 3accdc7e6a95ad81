"""Thousands of runs: a plan of what varies, workers that run it in batches, and the study of it."""
