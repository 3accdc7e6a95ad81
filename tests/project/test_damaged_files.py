"""Any damage to a file gives a result or an error in one line: no traceback, no hang, no memory."""

import faulthandler
import json
import resource
import sys
import time
import tomllib
from itertools import count
from pathlib import Path

import numpy as np
import pytest
import tomli_w
import xarray as xr
from hypothesis import HealthCheck, given, reject, seed, settings
from hypothesis import strategies as st

import crinoid
from crinoid.assembly.description import Description
from crinoid.assembly.neural import read_policy
from crinoid.recording import propose, read_dataset
from crinoid.recording.recording import read_recording
from crinoid.results.metrics import measured
from crinoid.results.result import RESULT, Result, ResultError
from crinoid.results.stream import Stream
from crinoid.scenario import Scenario, ScenarioError, builtin_files, builtin_names, builtin_text
from crinoid.simulation.batch import Arm
from crinoid.studies.sweep.plan import PLAN, SweepDesign, read_plan
from crinoid.studies.sweep.store import SweepStore
from helpers.damage import other_bytes, other_dataset, other_document
from helpers.made_results import made_result
from helpers.measured import measured as playing
from helpers.measured import swell, wave, write

FEW = 25
"""Examples of each reader in a quick run."""
MOST_BYTES = 2_000_000_000
"""Memory that reading a small file may ask for."""
LONGEST = 120
"""Time after which a reader hangs (s)."""
SMALL = "still-water", ["arm.nodes=6", "simulation.duration=1.0"]
CSV = b"time (s),u (m/s),w (m/s)\n" + b"".join(b"%d,0.3%d,-0.1\n" % (k, k % 7) for k in range(60))
DATED = b"date;u (cm/s);w (cm/s);flag\n" + b"".join(
    b"2024-03-01T06:%02d:00Z;3%d,5;-5;1\n" % (k, k % 7) for k in range(60)
)


def small_result():
    return made_result(crinoid.load(*SMALL))


def text_of(document):
    try:
        return tomli_w.dumps(document).encode()
    except (TypeError, ValueError):
        reject()


def file_of(dataset, folder):
    path = folder / "written.nc"
    try:
        dataset.to_netcdf(path, engine="netcdf4")
    except Exception:  # xarray has no form for all damage
        reject()
    return path.read_bytes()


def scenario(folder):
    def read(path):
        read = crinoid.load(path)
        assert Scenario.from_toml(read.to_toml()) == read
        assert read.cases()

    texts = st.sampled_from([builtin_text(name) for name in builtin_names()])
    files = texts.map(tomllib.loads).flatmap(other_document).map(text_of)
    return "a.toml", read, files | texts.map(str.encode).flatmap(other_bytes)


def play(path):
    with read_dataset(str(path)) as dataset:
        propose(dataset, str(path))
    case = playing(path, velocity=["u", "w"])
    read_recording(case.flow[0], case, {})


def table(folder):
    return "a.csv", play, st.sampled_from((CSV, DATED)).flatmap(other_bytes)


def record(folder):
    path, instants = folder / "record.nc", np.arange(60.0)
    write(path, instants, u=wave(instants), w=swell(instants))
    with xr.open_dataset(path, decode_times=False) as stored:
        dataset = stored.load()
    fields = other_dataset(dataset).map(lambda damaged: file_of(damaged, folder))
    return "a.nc", play, fields | other_bytes(path.read_bytes())


def use(path):
    for lazily in (True, False):
        found = Result.load(path.parent, lazily=lazily)
        assert isinstance(found.status + found.failure, str)
        assert isinstance(found.notes, list)
        assert isinstance(found.digests, dict)
        assert found.scenario.cases()


def result(folder):
    made = small_result()
    (path,) = made.save(folder)
    fields = other_dataset(made.dataset).map(lambda damaged: file_of(damaged, folder))
    return RESULT, use, fields | other_bytes(path.read_bytes())


def growing_result(folder):
    path, data = folder / RESULT, small_result().dataset
    Stream(path, data.isel(time=[0]), [data.isel(time=slice(1, None))], {"x": np.ones(3)}, 1.0)
    return RESULT, use, other_bytes(path.read_bytes())


def policy(folder):
    (path,) = builtin_files("station-keeping")
    line, _, numbers = path.read_bytes().partition(b"\n")

    def read(path):
        described = Description.of(path)
        policy, same = read_policy(path)
        assert same == described
        assert len(policy.layers) == len(described.layers)

    heads = other_document(json.loads(line)).map(lambda head: json.dumps(head, default=str))
    files = heads.map(lambda head: head.encode() + b"\n" + numbers)
    return "a.eqx", read, files | other_bytes(path.read_bytes())


def sweep(folder):
    plan = SweepDesign.of(crinoid.load(*SMALL), ["arm.length=0.3:0.6:3"], seeds=2, batch=6)

    def read(path):
        store = SweepStore(path.parent)
        read = read_plan(store.folder)
        assert store.finished(read) == set()
        assert all(read.name(run) and read.values(run) for run in range(1, min(read.runs, 9)))

    files = other_document(tomllib.loads(plan.to_toml())).map(text_of)
    return PLAN, read, files | other_bytes(plan.to_toml().encode())


def batch(folder):
    plan = SweepDesign.of(crinoid.load(*SMALL), ["arm.length=0.3:0.6:3"], seeds=2, batch=6)
    store, found = SweepStore(folder), measured(small_result())
    store.start(plan)
    store.save(plan, 0, plan.batches[0], 6 * [Arm(found, "ok", [])])
    (path,) = (folder / "batches").iterdir()

    def read(path):
        (path.parent / "batches").mkdir()
        store = SweepStore(path.parent)
        path.rename(path.parent / "batches" / path.name)
        if store.finished(plan):
            data, _ = store.collect(plan)
            assert data.sizes["run"] == 6

    fields = other_dataset(xr.load_dataset(path)).map(lambda damaged: file_of(damaged, folder))
    return path.name, read, fields | other_bytes(path.read_bytes())


READERS = [scenario, table, record, result, growing_result, policy, sweep, batch]
readers = pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.__name__)


@pytest.fixture
def bounded():
    """Bound the memory, and end the process where a library hangs."""
    before = resource.getrlimit(resource.RLIMIT_AS)
    if sys.platform == "linux":
        pages = int(Path("/proc/self/statm").read_text("ascii").split()[0])
        most = pages * resource.getpagesize() + MOST_BYTES
        resource.setrlimit(resource.RLIMIT_AS, (most, before[1]))
    yield lambda seconds: faulthandler.dump_traceback_later(seconds, exit=True)
    faulthandler.cancel_dump_traceback_later()
    resource.setrlimit(resource.RLIMIT_AS, before)


def check(reader, folder, examples, number):
    """Read damaged files, the same ones for the same number."""
    name, read, files = reader(folder)
    places = count()

    @seed(number)
    @settings(
        max_examples=examples,
        deadline=None,
        database=None,
        suppress_health_check=list(HealthCheck),
    )
    @given(files)
    def reads(content):
        # a new folder each: libraries know a file again by its path
        path = folder / f"{next(places)}" / name
        path.parent.mkdir()
        path.write_bytes(content)
        try:
            read(path)
        except (ScenarioError, ResultError) as error:
            lines = error.lines if isinstance(error, ScenarioError) else [str(error)]
            assert lines
            assert not any("\n" in line or "Unable to allocate" in line for line in lines)

    reads()


@readers
def test_damaged_files_are_refused_in_one_line(reader, tmp_path, bounded):
    bounded(LONGEST)
    check(reader, tmp_path, FEW, 0)


@pytest.mark.release
@readers
def test_files_damaged_anew_are_refused_in_one_line(reader, tmp_path, bounded, pytestconfig):
    seconds = pytestconfig.getoption("fuzz")
    if not seconds:
        pytest.skip("needs --fuzz SECONDS: each time other files")
    until = time.monotonic() + seconds
    number = time.time_ns() % 10**9
    while time.monotonic() < until:
        number += 1
        print(f"check({reader.__name__}, folder, 100, {number})")
        (folder := tmp_path / f"{number}").mkdir()
        bounded(LONGEST)
        check(reader, folder, 100, number)
