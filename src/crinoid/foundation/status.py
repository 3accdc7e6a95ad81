"""Status of a run."""

from collections.abc import Iterable
from enum import StrEnum


class Status(StrEnum):
    """First word of a status; the reason and the time follow."""

    OK = "ok"
    FAILED = "failed"
    INTERRUPTED = "interrupted"
    UNFINISHED = "unfinished"
    """It is still running, or the program was killed."""

    @staticmethod
    def of(words: object) -> "Status | None":
        """Return the status at the start of words, None if there is none."""
        return next((status for status in Status if str(words).startswith(status)), None)


def summed(statuses: Iterable[object]) -> str:
    """Return the common status of many runs."""
    words = [str(each) for each in statuses]
    wrong = [each for each in words if Status.of(each) is not Status.OK]
    if not wrong:
        return Status.OK.value
    stopped = [each for each in wrong if Status.of(each) is Status.INTERRUPTED]
    if stopped:
        return f"{Status.INTERRUPTED}: {len(words) - len(wrong)} of {len(words)} runs are complete"
    return f"{Status.FAILED}: {len(wrong)} of {len(words)} runs did not reach their end"
