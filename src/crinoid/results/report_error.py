"""Error of a report that cannot be drawn."""


class ReportError(ValueError):
    """A report cannot be drawn; the message is one line that says why."""
