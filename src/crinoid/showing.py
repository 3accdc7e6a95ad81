"""Drawing of results, from below.

What draws lies above the results, which know nothing of it. `crinoid` itself, above all, says here
which module it is, and that module is loaded when a result is first shown.
"""

from collections.abc import Callable
from typing import Any, Protocol


class Showing(Protocol):
    """A module that shows results."""

    @staticmethod
    def html_of(result: Any) -> str:
        """Return a result as HTML, whatever it holds."""

    @staticmethod
    def plots_of(result: Any) -> Any:
        """Return the plots of a result."""


shown_by: Callable[[], Showing]
"""Gives the module; set once, by `crinoid` when it is imported."""
