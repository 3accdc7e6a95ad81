"""``python -m crinoid`` is the command ``crinoid``."""

from crinoid.cli import main

main()
