"""Settings of every test: compiled code kept between runs, and shapes checked at run time."""

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
# as in crinoid's own programs (`crinoid.programs.OFTEN`): a third less to compile
os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} --xla_cpu_use_fusion_emitters=false"
# Most of what the tests compile runs for less time than XLA would spend on making it faster. A file
# of which that is not true says `RUNS_LONG = True`.
os.environ.setdefault("JAX_DISABLE_MOST_OPTIMIZATIONS", "true")

from jaxtyping import install_import_hook  # noqa: E402

# Only modules imported from here on are checked: nothing above may import crinoid.
install_import_hook("crinoid", "beartype.beartype")


@pytest.fixture(autouse=True, scope="module")
def _compiled_code(request: pytest.FixtureRequest) -> Iterator[None]:
    """Let go of what a file compiled: thousands of programs in one process crash it."""
    import jax

    from crinoid.programs.store import STORE

    quickly = jax.config.read("jax_disable_most_optimizations")
    if getattr(request.module, "RUNS_LONG", False):
        jax.config.update("jax_disable_most_optimizations", False)
    yield
    jax.config.update("jax_disable_most_optimizations", quickly)
    STORE.set(None)  # which a command has set
    jax.clear_caches()
    gc.collect()
