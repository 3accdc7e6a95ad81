"""Settings of every test: compiled code kept between runs, and shapes checked at run time."""

import ctypes
import gc
import math
import os
import sys
from collections import Counter
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
# Fusions as in crinoid's own programs (`crinoid.programs.OFTEN`): a third less to compile; in one
# piece, as two workers use two cores anyway. Left out is what makes one large kernel of a loop, and
# what moves values out of it: a third of the time to compile, more than runs here gain by it.
_PASSES = "small-while-loop-hoisting,while-loop-invariant-code-motion"
os.environ["XLA_FLAGS"] = (
    f"{os.environ.get('XLA_FLAGS', '')} --xla_cpu_use_fusion_emitters=false"
    f" --xla_cpu_parallel_codegen_split_count=1 --xla_disable_hlo_passes={_PASSES}"
)
# Two workers use two cores; threads of linear algebra would but wait for each other.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# Most of what the tests compile runs for less time than XLA would spend on making it faster.
os.environ.setdefault("JAX_DISABLE_MOST_OPTIMIZATIONS", "true")

# Where an operation comes from is of use in profiles only, and part of all that is compiled.
os.environ.setdefault("JAX_TRACEBACK_IN_LOCATIONS_LIMIT", "0")

from jaxtyping import install_import_hook  # noqa: E402

# as crinoid's own programs do: tracing makes many objects and leaves hardly any garbage
gc.set_threshold(50_000)

# Only modules imported from here on are checked: nothing above may import crinoid.
install_import_hook("crinoid", "beartype.beartype")


_LONGEST = (
    *("test_builtin", "test_threads", "test_builtin_tasks", "test_learning", "test_vehicle"),
    *("test_rollout", "test_scheduled", "test_builtin_long", "test_live", "test_space_dynamics"),
    *("test_mpc", "test_transition", "test_builtin_space", "test_environment"),
    *("test_space_statics", "test_identify", "test_docs", "test_tuning", "test_sweep", "test_lqg"),
    *("test_simulation", "test_obstacles", "test_report", "test_space_gradients", "test_hybrid"),
    *("test_cli", "test_tool", "test_saving", "test_actuation", "test_report_space"),
)
"""Files that take longest, in that order: begun first, so that workers end at about one time."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put the tests of the longest files first."""
    rank = {name: number for number, name in enumerate(_LONGEST)}
    items.sort(key=lambda item: rank.get(item.path.stem, len(rank)))


def pytest_terminal_summary(
    terminalreporter: pytest.TerminalReporter, config: pytest.Config
) -> None:
    """Beside the slowest tests, that ``--durations`` asks for, tell how long each file took."""
    if config.getoption("durations") is None:
        return
    spent: Counter[str] = Counter()
    for reports in terminalreporter.stats.values():
        for report in reports:
            if isinstance(report, pytest.TestReport):
                spent[report.nodeid.partition("::")[0]] += report.duration
    terminalreporter.section("time of each file")
    for name, seconds in spent.most_common():
        terminalreporter.write_line(f"{seconds:7.1f}s {name}")


_MOST_BYTES = 2_000_000_000
"""Memory from which on a process looks for some to let go."""


@pytest.fixture(autouse=True, scope="module")
def _compiled_code() -> Iterator[None]:
    """Let go of memory where there is too much of it, and of compiled code if nothing else will do.

    Most of it is what compiling took: free, but kept for what comes next.
    """
    import jax

    from crinoid.programs.store import STORE

    yield
    STORE.set(None)  # which a command has set
    if _resident() > _MOST_BYTES:
        _hand_back()
    if _resident() > _MOST_BYTES:
        jax.clear_caches()
        gc.collect()
        _hand_back()


def _hand_back() -> None:
    """Hand memory that is free back to the system: glibc does when it is asked."""
    if sys.platform == "linux" and hasattr(found := ctypes.CDLL(None), "malloc_trim"):
        found.malloc_trim(0)


@pytest.fixture(scope="module")
def optimised() -> Iterator[None]:
    """Let XLA optimise after all, for files whose runs take longer than that."""
    import jax

    name = "jax_disable_most_optimizations"
    before = jax.config.read(name)
    jax.config.update(name, False)
    yield
    jax.config.update(name, before)


def _resident() -> float:
    """Return the memory that this process holds (bytes); where no system tells, too much."""
    try:
        pages = int(Path("/proc/self/statm").read_text("ascii").split()[1])
    except OSError:
        return math.inf
    return pages * os.sysconf("SC_PAGE_SIZE")
