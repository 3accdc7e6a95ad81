"""Where compiled programs are kept: a folder that nobody but its user can write to."""

import hashlib
import os
import stat
from collections.abc import Callable
from contextlib import suppress
from contextvars import ContextVar
from pathlib import Path

import jax
import platformdirs

from crinoid.replacement import replacing

_SUFFIX = ".program"
_MARK = b"crinoid program\n"
_MOST_BYTES = 500_000_000
"""Size of all files together past which those go that have not been used for longest."""


class Store:
    """Files of a folder, by keys.

    What is read will be run. So nothing is read, nor written, where the folder or the file is of
    another user or open to others, and what is damaged, cut off or of another key is not there.
    """

    def __init__(self, folder: Path, most_bytes: int = _MOST_BYTES) -> None:
        self.folder = folder
        self._most_bytes = most_bytes

    def read(self, key: bytes) -> bytes | None:
        """Return what is kept under a key, None where there is nothing that can be trusted."""
        path = self._path(key)
        try:
            if not _is_private(self.folder.lstat(), stat.S_ISDIR):
                return None
            # not through a link, and looked at once it is open: nobody can change it in between
            with open(os.open(path, os.O_RDONLY | _AS_IT_IS), "rb") as file:
                if not _is_private(os.fstat(file.fileno()), stat.S_ISREG):
                    return None
                head, content = file.read(len(_head(key, b""))), file.read()
            os.utime(path)  # what is used stays
        except OSError:
            return None
        return content if head == _head(key, content) else None

    def write(self, key: bytes, content: bytes) -> None:
        """Keep something under a key if that can be done, and drop what is too much."""
        with suppress(OSError):
            self.folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            if _is_private(self.folder.lstat(), stat.S_ISDIR):
                with replacing(self._path(key), private=True) as temporary:
                    temporary.write_bytes(_head(key, content) + content)
                self._make_room()

    def holds(self, key: bytes) -> bool:
        """Tell whether there is something under a key, be it of use or not."""
        return os.path.exists(self._path(key))

    def remove(self, key: bytes) -> None:
        """Remove what is kept under a key."""
        with suppress(OSError):
            self._path(key).unlink()

    def _path(self, key: bytes) -> Path:
        return self.folder / f"{key.hex()}{_SUFFIX}"

    def _make_room(self) -> None:
        """Remove the files that have not been used for longest, but never the last one."""
        found = []
        for path in self.folder.iterdir():
            with suppress(OSError):  # another process may have removed it
                status = path.stat()
                found.append((status.st_mtime, status.st_size, path))
        size = sum(each for _, each, _ in found)
        for _, each, path in sorted(found)[:-1]:
            if size > self._most_bytes:
                with suppress(OSError):
                    path.unlink()
                size -= each


STORE: ContextVar[Store | None] = ContextVar("STORE", default=None)
"""Where programs are kept; None where they are not."""


def keep_programs() -> None:
    """Keep compiled programs from now on, so that later processes need not compile them.

    They are kept in the user's own cache folder, or in the folder ``crinoid`` of
    ``JAX_COMPILATION_CACHE_DIR`` where that is set; nowhere where ``JAX_ENABLE_COMPILATION_CACHE``
    is false. A program stands for crinoid as its files are: not for a process that changes
    crinoid's functions or constants.
    """
    chosen = jax.config.values["jax_compilation_cache_dir"]
    own = Path(chosen) / "crinoid" if chosen else platformdirs.user_cache_path("crinoid")
    kept = jax.config.values["jax_enable_compilation_cache"]
    STORE.set(Store(own / "programs") if kept else None)


_AS_IT_IS = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0)


def _head(key: bytes, content: bytes) -> bytes:
    return _MARK + hashlib.sha256(key).digest() + hashlib.sha256(content).digest()


def _is_private(found: os.stat_result, is_kind: Callable[[int], bool]) -> bool:
    """Tell whether a file or folder is of this user and closed to all others."""
    if not is_kind(found.st_mode):
        return False
    if not hasattr(os, "getuid"):  # Windows, where a folder of the user's is closed by itself
        return True
    return found.st_uid == os.geteuid() and not found.st_mode & 0o077
