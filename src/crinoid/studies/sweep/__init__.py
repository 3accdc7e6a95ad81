"""Thousands of runs: a plan of what varies, workers that run it in batches, and the study of it."""

from crinoid.studies.sweep.engine import WorkerPool as WorkerPool
from crinoid.studies.sweep.engine import WorkerPoolError as WorkerPoolError
from crinoid.studies.sweep.engine import run_batches as run_batches
from crinoid.studies.sweep.plan import SweepDesign as SweepDesign
from crinoid.studies.sweep.store import PLAN as PLAN
from crinoid.studies.sweep.store import SweepStore as SweepStore
from crinoid.studies.sweep.store import has_zarr as has_zarr
