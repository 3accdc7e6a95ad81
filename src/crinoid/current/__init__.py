"""The current of a scenario by itself: sampled at the arm at rest, and summed up in numbers."""

from crinoid.current.sample import FLOW as FLOW
from crinoid.current.sample import sample_current as sample_current
from crinoid.current.statistics import Statistics as Statistics
from crinoid.current.statistics import statistics as statistics
