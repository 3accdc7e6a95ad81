"""Words of messages on files."""

from pathlib import Path

REMARKS = "remarks of crinoid"  # attribute of a dataset: what its reader assumes, a line each
MINUS = "\N{MINUS SIGN}"  # the sign that typesetters prefer to a hyphen
_NAMED = 12


def reason_of(error: Exception) -> str:
    """Return the reason of an error in one line."""
    return " ".join(str(getattr(error, "strerror", None) or error).split())[:200]


def listed(names: list[str]) -> str:
    """Return the first dozen names, with commas between them."""
    more = len(names) - _NAMED
    return ", ".join(names[:_NAMED]) + (f" and {more} more" if more > 0 else "")


def short(file: str) -> str:
    """Return the name of a file without its folder."""
    return Path(file).name
