"""How a run ended."""

from enum import StrEnum


class Status(StrEnum):
    """The first word of a status, before what went wrong and when."""

    OK = "ok"
    FAILED = "failed"
    INTERRUPTED = "interrupted"
    UNFINISHED = "unfinished"
    """It is still run, or the program was killed."""

    @staticmethod
    def of(words: object) -> "Status | None":
        """Return the status that words begin with; None where they tell none."""
        return next((status for status in Status if str(words).startswith(status)), None)
