"""Hook by which a result finds the package that draws it, so that results need not import it."""

from collections.abc import Callable
from typing import Any

notebook: Callable[[], Any]
"""Return `crinoid.view.notebook`, loaded at the first use; `crinoid` sets it."""
