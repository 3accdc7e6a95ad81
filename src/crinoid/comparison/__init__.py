"""Controllers side by side: the same scenario under each of them, over many seeds."""

from crinoid.comparison.comparison import COMPARISON as COMPARISON
from crinoid.comparison.comparison import Comparison as Comparison
from crinoid.comparison.gains import controlled_by as controlled_by
