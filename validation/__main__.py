"""``python -m validation`` runs the cases."""

from crinoid.cli import main

main("validation.command")
