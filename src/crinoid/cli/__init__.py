"""The command line: commands, progress, exit codes; no physics."""


def main() -> None:
    """Run the command line."""
    from crinoid.cli.app import app

    app()
