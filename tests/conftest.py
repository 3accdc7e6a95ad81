"""Settings of every test: which run, compiled code kept between runs, shapes checked."""

import argparse
import ctypes
import gc
import json
import math
import os
import signal
import sys
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path

import pytest

# Compiling is most of what the tests cost, so the compiled code is kept. JAX reads these when it
# is imported, which must be later; as environment variables they also reach the programs that
# tests start and the workers of a parallel run.
ROOT = Path(__file__).resolve().parents[1]
_CACHE = ROOT / ".pytest_cache" / "jax"
os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(_CACHE))
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0.1")
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES", "-1")
# Fusions as in crinoid's own programs (`crinoid.compilation.OFTEN`): a third less to compile; in
# one piece, as two workers use two cores anyway. Left out is what makes one large kernel of a loop,
# and what moves values out of it: a third of the time to compile, more than runs here gain by it.
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

# A script that starts the tests with `&`, or nohup, has them ignore Ctrl-C, which some tests send.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

TIERS = ("quick", "slow", "release")
"""Tests for everybody, those of each change (``--all``), and those of a release (``--release``)."""
MOST = {"quick": 20.0, "slow": 60.0, "release": math.inf}
"""CPU time of a test of a tier, on a machine of speed 1 (s)."""
COSTS = ROOT / ".ci" / "costs.json"
"""CPU time of each file by tier (s), by which files are ordered and shared out."""
_SHAPED = [f"crinoid.{name}" for name in ("dynamics", "elements", "flow", "numerics", "rod")]
"""Packages whose shapes are checked in every run; with slow tests those of all are."""


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the choice of tests, and the check of what they cost."""
    parser.addoption("--all", action="store_true", help="run the slow tests as well")
    parser.addoption("--release", action="store_true", help="run all tests")
    parser.addoption(
        "--costs",
        metavar="SLOWNESS",
        type=float,
        help="list the CPU time of files; fail a test that needs more than its tier allows, times "
        "how slow the machine is (.ci/speed.py)",
    )
    parser.addoption(
        "--keep-costs", action="store_true", help=f"write them into {COSTS.relative_to(ROOT)}"
    )
    parser.addoption(
        "--shard",
        metavar="K/N",
        type=_shard,
        default=(1, 1),
        help="run part K of N of the files only",
    )
    parser.addoption(
        "--fuzz",
        metavar="SECONDS",
        type=float,
        default=0.0,
        help="time for which a release test gives each reader damaged files of new seeds",
    )


def _shard(text: str) -> tuple[int, int]:
    """Return the number of a part and that of all parts."""
    number, _, count = text.partition("/")
    if number.isdecimal() and count.isdecimal() and 1 <= int(number) <= int(count):
        return int(number), int(count)
    raise argparse.ArgumentTypeError(f"got {text}; must be K/N with 1 <= K <= N, such as 1/3")


def pytest_configure(config: pytest.Config) -> None:
    """Check shapes at run time, of what is imported from here on."""
    from jaxtyping import install_import_hook

    if config.getoption("keep_costs") and not config.getoption("costs"):
        raise pytest.UsageError("--keep-costs: needs --costs SLOWNESS")
    every = config.getoption("all") or config.getoption("release")
    shaped = ["crinoid", "validation", "benchmarks"] if every else _SHAPED
    install_import_hook(shaped, "beartype.beartype")
    # as crinoid's own programs do: tracing makes many objects and leaves hardly any garbage
    gc.set_threshold(50_000)


def _highest(config: pytest.Config) -> int:
    """Return the number of the highest tier that is run: any for tests named or chosen by marks."""
    if config.getoption("release") or any("::" in each for each in config.args):
        return 2
    return 1 if config.getoption("all") else 2 * bool(config.getoption("markexpr"))


def _tier(item: pytest.Item) -> int:
    """Return the number of the tier of a test: that of its highest mark."""
    return 2 if item.get_closest_marker("release") else bool(item.get_closest_marker("slow"))


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out higher tiers, unless named one by one, and other shards; costly files go first.

    A file is the work of one worker: so that all of them end at about one time.
    """
    highest = _highest(config)
    costs = _costs(item for item in items if _tier(item) <= highest)
    number, count = config.getoption("shard")
    shares = [Counter[str]() for _ in range(count)]
    for path, cost in costs.most_common():
        min(shares, key=lambda share: share.total())[path] = cost
    own = shares[number - 1]
    kept = [item for item in items if _tier(item) <= highest and _file(item) in own]
    config.hook.pytest_deselected(items=list(set(items) - set(kept)))
    items[:] = sorted(kept, key=lambda item: -own[_file(item)])


def _file(test: pytest.Item | pytest.TestReport) -> str:
    """Return the path of a test's file from the root."""
    return test.nodeid.partition("::")[0]


def _costs(items: Iterable[pytest.Item]) -> Counter[str]:
    """Return the CPU time of the files of some tests (s), a guess for new ones."""
    known = json.loads(COSTS.read_text("utf-8"))
    found = Counter[str]()
    for path, tier in sorted({(_file(item), TIERS[_tier(item)]) for item in items}):
        found[path] += known.get(path, {}).get(tier, 10.0)
    return found


_STARTED = pytest.StashKey[float]()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Note when a test begins, its fixtures included."""
    item.stash[_STARTED] = _cpu_time()
    return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Iterator[None]:
    """Fail a test that passes, but needs more CPU time than its tier allows."""
    report = yield
    if report.when == "call" and (slowness := item.config.getoption("costs")):
        tier = TIERS[_tier(item)]
        cost, most = _cpu_time() - item.stash[_STARTED], MOST[tier] * slowness
        report.user_properties += [("cpu", cost), ("tier", tier)]
        if report.passed and cost > most:
            report.outcome = "failed"
            report.longrepr = (
                f"{item.nodeid}: {cost:.1f} s of CPU time; must be at most {most:.1f} s in the "
                f"tier {tier}. Make it smaller, or move it to the next tier by its mark."
            )
    return report


def pytest_terminal_summary(
    terminalreporter: pytest.TerminalReporter, config: pytest.Config
) -> None:
    """List the costs of each file, and keep them if asked."""
    if not (slowness := config.getoption("costs")):
        return
    spent, single = Counter[tuple[str, str]](), Counter[str]()
    for reports in terminalreporter.stats.values():
        for report in reports:
            if isinstance(report, pytest.TestReport) and (known := dict(report.user_properties)):
                spent[_file(report), known["tier"]] += known["cpu"]
                single[report.nodeid] = known["cpu"]
    terminalreporter.section("CPU time of each file")
    for (name, tier), seconds in spent.most_common():
        terminalreporter.write_line(f"{seconds:7.1f} s {name} ({tier})")
    terminalreporter.section("The costliest tests")
    for name, seconds in single.most_common(50):
        terminalreporter.write_line(f"{seconds:7.1f} s {name}")
    if config.getoption("keep_costs"):
        known = json.loads(COSTS.read_text("utf-8"))
        for (name, tier), seconds in spent.items():
            known.setdefault(name, {})[tier] = round(seconds / slowness, 1)
        there = {name: known[name] for name in sorted(known) if (ROOT / name).exists()}
        rows = ",\n".join(f" {json.dumps(name)}: {json.dumps(there[name])}" for name in there)
        COSTS.write_text(f"{{\n{rows}\n}}\n", "utf-8")


def _cpu_time() -> float:
    """Return the CPU time of this process and of those that it started and that ended (s)."""
    return sum(os.times()[:4])


_MOST_BYTES = 2_000_000_000
"""Memory from which on a process looks for some to let go."""


@pytest.fixture(autouse=True, scope="module")
def _programs() -> Iterator[None]:
    """Let go of memory after a file, and of programs if nothing else will do.

    Most of it is what compiling took: free, but kept for what comes next.
    """
    from crinoid.compilation import free_memory

    yield
    if _resident() > _MOST_BYTES:
        _hand_back()
    if _resident() > _MOST_BYTES:
        free_memory()


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
