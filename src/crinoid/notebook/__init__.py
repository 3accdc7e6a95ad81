"""Results in notebooks: their numbers, a small animation, and plots.

`crinoid.showing` gives it to results.
"""

from crinoid.notebook.html import html_of
from crinoid.notebook.plots import Plots, plots_of

__all__ = ["Plots", "html_of", "plots_of"]
