"""Folder for files that crinoid makes by itself and uses again."""

from pathlib import Path

import platformdirs


def cache_folder(chosen: str | None) -> Path:
    """Return the user's cache folder, or ``crinoid`` in a chosen one, such as that of JAX."""
    return Path(chosen) / "crinoid" if chosen else platformdirs.user_cache_path("crinoid")
