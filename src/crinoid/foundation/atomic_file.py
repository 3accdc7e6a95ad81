"""Atomic file replacement."""

import errno
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

FilePath = str | os.PathLike[str]  # type of a path to a file or a folder

_UNFINISHED = ".unfinished"  # suffix of temporary files

_PROBE = 1 << 24  # bytes of a probe that fails on a full disk


@contextmanager
def atomic_write(path: Path, *, private: bool = False) -> Iterator[Path]:
    """Yield a temporary file to write, which replaces ``path`` at the end.

    After an exception ``path`` is unchanged. A link of that name is replaced, not followed. A
    ``private`` file is closed to other users.
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
            os.fsync(written.fileno())  # otherwise a power cut could leave an empty file
        temporary.replace(path)
    except (OSError, RuntimeError, UnicodeEncodeError) as error:  # the latter from netCDF
        raise _reason(error, path.parent) from error
    finally:
        with suppress(OSError):
            temporary.unlink()


def remove_unfinished(path: Path) -> None:
    """Remove temporary files for ``path`` of a program that was killed."""
    for temporary in path.parent.glob(f".{path.name}.????????{_UNFINISHED}"):
        with suppress(OSError):
            temporary.unlink()


def _reason(error: Exception, folder: Path) -> OSError:
    """Return why a file could not be written: errors of netCDF often lack the reason."""
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
