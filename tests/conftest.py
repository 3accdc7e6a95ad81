"""What every test runs under: compiled code kept between runs, and shapes checked at run time."""

import gc
import os
from collections.abc import Iterator
from pathlib import Path

import pytest

# Compiling is most of what the tests cost, so the compiled code is kept. JAX reads these when it
# is imported, which must be later; as environment variables they also reach the programs that
# tests start and the workers of a parallel run.
_CACHE = Path(__file__).resolve().parents[1] / ".pytest_cache" / "jax"
os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(_CACHE))
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0.1")
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES", "-1")
# A third less to compile, as in crinoid's own programs (`crinoid.programs.OFTEN`); and quickly, as
# most of what the tests compile runs for less time than XLA would spend on making it faster.
_FLAGS = "--xla_cpu_use_fusion_emitters=false --xla_backend_optimization_level=0"
os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} {_FLAGS}"

from jaxtyping import install_import_hook  # noqa: E402

# Only modules imported from here on are checked: nothing above may import crinoid.
install_import_hook("crinoid", "beartype.beartype")


@pytest.fixture(autouse=True, scope="module")
def _forget_compiled_code() -> Iterator[None]:
    """Let go of what a file compiled: thousands of programs in one process crash it."""
    yield
    import jax

    from crinoid.programs.store import STORE

    STORE.set(None)  # which a command has set
    jax.clear_caches()
    gc.collect()
