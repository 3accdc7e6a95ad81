"""``python -m benchmarks`` runs the benchmarks."""

from crinoid.cli import main

main("benchmarks.command")
