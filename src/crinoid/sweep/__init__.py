"""Thousands of runs: a plan of what varies, workers that run it in batches, and the study of it."""

from crinoid.sweep.crew import Crew as Crew
from crinoid.sweep.crew import CrewError as CrewError
from crinoid.sweep.engine import run_batches as run_batches
from crinoid.sweep.plan import Plan as Plan
from crinoid.sweep.store import PLAN as PLAN
from crinoid.sweep.store import SweepStore as SweepStore
from crinoid.sweep.store import has_zarr as has_zarr
