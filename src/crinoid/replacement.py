"""Files that are replaced only once their successor is complete."""

import errno
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

__all__ = ["FilePath", "remove_unfinished", "replacing"]

FilePath = str | os.PathLike[str]
"""What users give for a file or a folder."""

_UNFINISHED = ".unfinished"
"""How names of temporary files end."""

_PROBE = 1 << 24
"""Bytes that are more than is left where a file did not fit."""


@contextmanager
def replacing(path: Path, *, private: bool = False) -> Iterator[Path]:
    """Give a temporary file to write, which takes the name ``path`` at the end.

    If anything is raised in between, ``path`` stays as it was. A link of that name is replaced and
    not followed. A ``private`` file is closed to other users.
    """
    try:
        handle, name = tempfile.mkstemp(_UNFINISHED, f".{path.name}.", path.parent)
        os.close(handle)
    except OSError as error:
        raise _reason(error, path.parent) from error
    temporary = Path(name)
    try:
        yield temporary
        if not private:
            temporary.chmod(0o666 & ~_umask())
        with temporary.open("rb") as written:
            os.fsync(written.fileno())  # else a power cut could leave the name with nothing in it
        temporary.replace(path)
    except (OSError, RuntimeError) as error:  # RuntimeError from netCDF
        raise _reason(error, path.parent) from error
    finally:
        with suppress(OSError):
            temporary.unlink()


def remove_unfinished(path: Path) -> None:
    """Remove what a program that was killed left of a successor to ``path``."""
    for temporary in path.parent.glob(f".{path.name}.????????{_UNFINISHED}"):
        with suppress(OSError):
            temporary.unlink()


def _reason(error: Exception, folder: Path) -> OSError:
    """Return why a file could not be written: netCDF itself often cannot tell."""
    try:
        with tempfile.TemporaryFile(dir=folder) as probe:
            probe.write(bytes(_PROBE))
            probe.flush()
    except OSError as found:
        return OSError(found.errno, found.strerror, str(folder))
    text = error.strerror if isinstance(error, OSError) else None
    return OSError(errno.EIO, text or " ".join(str(error).split()), str(folder))


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
