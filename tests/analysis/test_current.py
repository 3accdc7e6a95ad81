"""A scenario's current by itself: its numbers against theory, and `crinoid flow`."""

import hashlib
import importlib
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from scipy.integrate import quad
from scipy.signal import lfilter, welch

from crinoid.analysis.current import current_statistics, sample_current
from crinoid.assembly.prepared import Prepared
from crinoid.numerics.signals_and_systems import integral_time, spectrum, von_karman
from crinoid.results.result import Result
from crinoid.scenario import Scenario, builtin_names, library, load
from helpers.command import refused, succeeded
from helpers.figures import assert_shows_something, quick_and_release
from helpers.made_results import Player
from helpers.paths import ROOT
from helpers.scripts import load_script

FIGURES = ["flow.png", "spectrum.png", "profile.png"]


# --- numbers -----------------------------------------------------------------------------------


def test_the_integral_time_is_that_of_the_correlation():
    # of a Markov process its correlation time
    correlation_time, interval = 2.0, 0.1
    damping = np.exp(-interval / correlation_time)
    noise = np.random.default_rng(1).normal(size=200_000)
    process = lfilter([np.sqrt(1 - damping**2)], [1, -damping], noise)
    assert integral_time(process, interval) == pytest.approx(correlation_time, rel=0.1)
    # of a sine the integral of cos(2 pi t / 4 s) up to 1 s
    sine = np.sin(2 * np.pi * np.arange(0, 1000, 0.01) / 4.0)
    assert integral_time(sine, 0.01) == pytest.approx(4.0 / (2 * np.pi), rel=2e-3)


def test_statistics_of_a_known_series():
    swing = np.sin(2 * np.pi * np.arange(0, 100, 0.01) / 5.0)
    velocity = np.stack([0.3 + 0.1 * swing, -0.4 + 0 * swing], axis=1)
    found = current_statistics(velocity, 0.01, "xz")
    expected = {
        "mean x, z (m/s)": [0.3, -0.4],
        "deviation x, z (m/s)": [0.1 / np.sqrt(2), 0.0],
        "intensity x, z (%)": [20 / np.sqrt(2), 0.0],
    }
    for name, values in expected.items():
        unit = 100 if "%" in name else 1
        np.testing.assert_allclose(found[name] / unit, np.array(values) / unit, atol=1e-12)
    assert found["largest speed (m/s)"] == pytest.approx(np.hypot(0.4, 0.4), rel=1e-6)
    assert found["mean speed (m/s)"] == pytest.approx(np.hypot(velocity[:, 0], 0.4).mean())
    time = found["integral time x, z (s)"]
    np.testing.assert_array_equal(np.isnan(time), [False, True])  # what is steady has none
    np.testing.assert_allclose(found["integral length x, z (m)"], 0.5 * time)
    # without a mean there is no intensity
    swing = 1e-3 + np.tile([1.0, -1.0], 50)
    found = current_statistics(np.stack([swing, np.zeros(100)], axis=1), 0.1, "xz")
    assert np.isnan(found["intensity x, z (%)"]).all()
    assert np.isnan(found["integral length x, z (m)"]).all()


def test_a_spectrum_is_the_mean_of_the_windows_without_holes():
    interval, count, middle = 0.05, 20_000, slice(5, -5)
    noise = np.random.default_rng(0).normal(scale=0.2, size=(count, 1, 1))
    whole = spectrum(noise, interval)
    assert whole.sound == whole.windows == 4
    # white: 0.04 m2/s2 spread over 0 to 10 Hz
    assert whole.density[middle].mean() == pytest.approx(0.04 / 10, rel=0.03)
    assert whole.frequency[-1] == pytest.approx(10.0)
    # holes of a quarter of the record, joined by straight lines
    holed, holes = noise.copy(), np.zeros(count, bool)
    for begin in range(5000, 15000, 2500):
        holes[begin : begin + 1250] = True
    there = np.flatnonzero(~holes)
    holed[:, 0, 0] = np.interp(np.arange(count), there, noise[there, 0, 0])
    found = spectrum(holed, interval, holes)
    assert 0 < found.sound < found.windows
    # as flat as it was, where all windows together have lost a part of its variance
    assert found.density[middle].mean() == pytest.approx(0.04 / 10, rel=0.05)
    assert spectrum(holed, interval).density[middle].mean() < 0.9 * 0.04 / 10
    # where no window is without, it is said and all are taken
    every = spectrum(holed, interval, np.arange(count) % 8 == 0)
    assert every.sound == 0
    assert np.isfinite(every.density).all()


@pytest.mark.parametrize("count", [640, 900, 301, 17, 16])
def test_a_spectrum_is_welchs(count):
    velocity = 3.0 + np.random.default_rng(count).normal(size=(count, 2, 3))
    found = spectrum(velocity, 0.3)
    length = min(count, max(256, 2 * count // 5))
    frequency, density = welch(velocity, 1 / 0.3, nperseg=length, detrend="constant", axis=0)
    np.testing.assert_allclose(found.frequency, frequency[1:], rtol=1e-12)
    np.testing.assert_allclose(found.density, density[1:], rtol=1e-10)


@pytest.mark.parametrize("along", [0.0, 0.5, 1.0])
def test_von_karmans_spectrum_adds_up_and_has_its_length(along):
    deviation, passing = 0.1, 3.0

    def density(frequency, along=along):
        return float(von_karman(np.array([frequency]), deviation, passing, along)[0])

    total = quad(density, 0, 1, limit=200)[0] + quad(density, 1, np.inf, limit=200)[0]
    assert total == pytest.approx(deviation**2, rel=1e-4)
    # S(0) is four times variance times integral time: whole along, half across
    assert density(0.0) / (4 * deviation**2) == pytest.approx(passing * (1 + along) / 2)
    steep = np.log(density(2e4) / density(1e4)) / np.log(2)
    assert steep == pytest.approx(-5 / 3, abs=1e-3)
    # isotropic: across it has 4/3 of what it has along
    assert density(1e4, 0.0) / density(1e4, 1.0) == pytest.approx(4 / 3, rel=1e-3)


def sampled(**tables):
    return sample_current(Prepared(Scenario(**tables)))


# --- sampling ----------------------------------------------------------------------------------


def test_a_current_is_sampled_where_the_arm_is():
    shear = {"kind": "shear", "velocity": [0.5, 0.0], "reference_depth": 4.0, "exponent": 0.5}
    sine = {"kind": "sine", "amplitude": [0.1, 0.0], "frequency_hz": 0.5}
    dataset = sampled(
        arm={"length": 0.6},
        base={"position": [1.0, -8.0], "tilt_deg": -90.0},
        water={"depth": 20.0},
        flow=[shear | {"ramp_time": 2.0}, sine],
        simulation={"duration": 10.0},
    )
    np.testing.assert_allclose(dataset["position"].sel(place="tip"), [1.0, -8.6], atol=1e-12)
    time, velocity = dataset["time"].values, dataset["flow_velocity"].sel(axis="x")
    sheared = 0.5 * np.sqrt(np.array([12.0, 11.4]) / 16.0)  # by height above the bed
    late = time >= 2.0
    assert dataset.attrs["settled"] == 2.0
    expected = sheared + 0.1 * np.sin(np.pi * time[late, None])
    np.testing.assert_allclose(velocity.values[late], expected, atol=1e-12)
    assert float(velocity.sel(time=0.0).values.max()) == 0.0
    heights = dataset["height"].values
    assert (heights[0], heights[-1]) == (-20.0, 0.0)
    mean = 0.5 * np.sqrt((20.0 + heights) / 16.0)
    np.testing.assert_allclose(dataset["profile_mean"].sel(axis="x"), mean, atol=2e-3)
    peak = dataset["frequency"].values[np.argmax(dataset["flow_spectrum"].values[:, 1, 0])]
    assert peak == pytest.approx(0.5, abs=0.15)
    assert "model_spectrum" not in dataset  # nothing random in it


@pytest.mark.slow
@pytest.mark.parametrize("profile", [{"exponent": 0.2}, {"roughness_length": 0.01}])
def test_an_arm_may_be_held_at_the_bed_where_no_current_is(profile):
    shear = {"kind": "shear", "velocity": [0.2, 0.0], "reference_depth": 5.0}
    flow = sampled(
        arm={"nodes": 5},
        base={"position": [0.0, -10.0], "tilt_deg": 90.0},
        water={"depth": 10.0},
        flow=[shear | profile],
        simulation={"duration": 1.0},
    )["flow_velocity"].sel(axis="x")
    height = 0.5 / (10.0 - 5.0)  # of the tip, over that at which the velocity is reached
    share = height**0.2 if "exponent" in profile else np.log(0.5 / 0.01) / np.log(5.0 / 0.01)
    np.testing.assert_allclose(flow.isel(place=0), 0.0, atol=1e-12)
    np.testing.assert_allclose(flow.isel(place=1), 0.2 * share, rtol=1e-9)


UNIFORM = {"kind": "uniform", "velocity": [0.2, 0.0]}


@pytest.mark.parametrize("start", [100.0, 0.0], ids=["not begun", "cancelled"])
def test_eddies_that_nothing_carries_past_have_no_spectrum_to_compare(start):
    eddies = {"kind": "turbulence", "mean": [0.2, 0], "intensity": 0.1, "length_scale": 0.5}
    against = [] if start else [UNIFORM | {"velocity": [-0.2, 0.0]}]
    flow = [eddies | {"modes": 8, "start": start}, *against]
    found = sampled(flow=flow, simulation={"duration": 2.0})
    compared = found.get("model_spectrum")
    assert compared is None or compared.attrs["comment"] == "fitted"
    assert np.isfinite(found["flow_spectrum"]).all()


@pytest.mark.release
def test_a_spatial_current_is_sampled_along_three_axes():
    mean, travel = np.array([0.3, 0.2, -0.1]), np.deg2rad(70)
    waves = {"kind": "waves", "significant_height": 1.0, "peak_period": 4.0, "direction_deg": 70.0}
    dataset = sampled(
        arm={"dimension": 3, "length": 0.6},
        base={"position": [1.0, 0.5, -8.0], "tilt_deg": -30.0, "pan_deg": 60.0},
        water={"depth": 20.0},
        flow=[UNIFORM | {"velocity": mean.tolist()}, waves],
        simulation={"duration": 40.0},
    )
    assert list(dataset["axis"].values) == ["x", "y", "z"]
    down, level = 0.6 * np.sin(np.pi / 6), 0.6 * np.cos(np.pi / 6)
    tip = [1.0 + 0.5 * level, 0.5 + np.sqrt(0.75) * level, -8.0 - down]
    np.testing.assert_allclose(dataset["position"].sel(place="tip"), tip, atol=1e-12)
    swing = (dataset["flow_velocity"] - mean).sel(place="root").values
    assert np.abs(swing).max() > 0.01
    # level, the water swings the way that the waves travel
    across = swing[:, 0] * np.sin(travel) - swing[:, 1] * np.cos(travel)
    np.testing.assert_allclose(across, 0.0, atol=1e-12)
    assert dataset["profile_mean"].dims == ("height", "axis")
    np.testing.assert_allclose(dataset["profile_mean"].values[0, 2], mean[2], atol=1e-6)  # the bed


@pytest.mark.parametrize(
    ("ramp_time", "settled", "note"),
    [(0.0, 0.0, ""), (4.0, 4.0, ""), (15.0, 15.0, "the last 5 s only"), (30.0, 0.0, "ramp too")],
)
def test_statistics_leave_out_ramps_or_say_that_they_do_not(ramp_time, settled, note):
    duration = 20.0 if ramp_time else 0.5
    dataset = sampled(flow=[UNIFORM | {"ramp_time": ramp_time}], simulation={"duration": duration})
    assert dataset.attrs["settled"] == settled
    assert dataset.attrs["notes"].endswith(note)
    assert bool(dataset.attrs["notes"]) == bool(note)
    deviation = float(dataset["profile_standard_deviation"].max())
    assert (deviation > 0.01) == (settled < ramp_time)


# --- the command -------------------------------------------------------------------------------

KINDS = {
    "uniform": 'kind = "uniform"\nvelocity = [0.2, 0.1]\nramp_time = 0.5',
    "shear": 'kind = "shear"\nvelocity = [0.2, 0.0]\nreference_depth = 1.0',
    "gust": 'kind = "gust"\nvelocity = [0.2, 0.0]\nduration = 1.0',
    "sine": 'kind = "sine"\namplitude = [0.2, 0.1]\nfrequency_hz = 1.0',
    "measured": 'kind = "measured"\nfile = "a.nc"\nvelocity = ["u", "w"]',
}


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    time = np.arange(0, 30, 0.1)
    random = np.random.default_rng(0)
    values = {"u": 0.5 + 0.02 * random.normal(size=time.size), "w": 0.01 * np.sin(time)}
    values["u"][40:45] = np.nan
    xr.Dataset(
        {name: ("time", series, {"units": "m/s"}) for name, series in values.items()},
        {"time": ("time", time, {"units": "s"})},
    ).to_netcdf(tmp_path / "a.nc")
    return tmp_path


def write(folder, kind, extra=""):
    text = f"title = 'A {kind} current'\nwater.depth = 20\nsimulation.duration = 2\n{extra}\n"
    (folder / "mine.toml").write_text(text + (f"[[flow]]\n{KINDS[kind]}\n" if kind else ""))


@pytest.mark.parametrize("kind", quick_and_release(KINDS, quick=1))
def test_every_kind_of_current_is_drawn_and_summed_up(here, kind):
    write(here, kind)
    assert "mean x, z (m/s)" in succeeded("flow", "mine.toml")
    folder = here / "results" / "mine-flow"
    assert sorted(path.name for path in folder.iterdir()) == sorted(["flow.nc", *FIGURES])
    for name in FIGURES:
        assert_shows_something(folder / name)
    with xr.open_dataset(folder / "flow.nc", decode_times=False) as dataset:
        for name in dataset.data_vars:
            assert dataset[name].attrs["units"]
            assert dataset[name].attrs["long_name"]
        assert ("model_spectrum" in dataset) == (kind == "measured")
        assert Scenario.from_toml(dataset.attrs["scenario"]).flow[0].kind == kind


def test_a_measured_current_is_described_with_its_repairs(here):
    write(here, "measured")
    written = succeeded("flow", "mine.toml", "--set", "simulation.duration=20", "--out", "out")
    assert "flow.0: a.nc, 29.9 s at 10 Hz, 300 samples at one place" in written
    with xr.open_dataset(here / "out" / "flow.nc") as dataset:
        assert dataset.attrs["notes"].startswith("flow.0: 1.67% of u is missing")


@pytest.mark.slow
def test_a_measured_sea_is_compared_with_its_components(here):
    time, frequency = np.arange(0, 60, 0.5), np.arange(0.1, 0.5, 0.02)
    rows = "".join(f"{t},{0.2 * np.cos(1.3 * t) + 0.2 * np.cos(1.7 * t)}\n" for t in time)
    (here / "e.csv").write_text(f"time (s),elevation (m)\n{rows}")
    rows = "".join(f"{f:.3g},{np.exp(-((10 * f - 2) ** 2))}\n" for f in frequency)
    (here / "s.csv").write_text(f"frequency (Hz),density (m2/Hz)\n{rows}")
    (here / "mine.toml").write_text(
        "simulation.duration = 2\nbase.position = [0, -3]\n"
        '[[flow]]\nkind = "waves"\nelevation = {file = "e.csv", skip = 20}\n'
        '[[flow]]\nkind = "waves"\nspectrum = {file = "s.csv"}\n'
    )
    written = succeeded("flow", "mine.toml", "--out", "out")
    assert written.count("peak period (s)") == 4  # a table and a note of each file
    assert_shows_something(here / "out" / "waves.png")
    with xr.open_dataset(here / "out" / "flow.nc", decode_times=False) as dataset:
        for index, height in enumerate((4 * 0.2, 4 * (0.1 * np.pi**0.5) ** 0.5)):
            found = dataset[f"sea_{index}_statistics"].values
            np.testing.assert_allclose(found[1, :3], found[0, :3], rtol=0.05)
            assert found[0, 0] == pytest.approx(height, rel=0.05)
        measured, components = dataset["sea_0_elevation"].values[:, ::4]
        np.testing.assert_allclose(measured, components, atol=1e-3)


def counted(monkeypatch, name: str) -> list[None]:
    """Count the calls of a function."""
    module, _, function = name.rpartition(".")
    original, calls = getattr(importlib.import_module(module), function), []

    def counting(*args, **kwargs):
        calls.append(None)
        return original(*args, **kwargs)

    monkeypatch.setattr(name, counting)
    return calls


@pytest.mark.slow
def test_notes_are_kept_and_a_run_is_resumed_from_elsewhere(here, monkeypatch):
    write(here, "measured", 'arm.nodes = 5\ncontrol.compare = false\nsimulation.start = "rest"')
    once = ("crinoid.recording.selection.read_dataset", "crinoid.assembly.system.assemble_once")
    counts = [counted(monkeypatch, name) for name in once]
    written = succeeded("run", "mine.toml", "--out", "out")
    assert list(map(len, counts)) == [1, 1]  # read once, built once
    assert "note: flow.0: 1.67% of u is missing" in written
    result = Result.load(here / "out")
    assert result.notes[0].startswith("flow.0: 1.67% of u is missing")
    (here / "deep").mkdir()
    monkeypatch.chdir(here / "deep")
    longer = ("--set", "simulation.duration=2.5")
    resumed = ("run", "../mine.toml", "--out", "../out", "--resume", *longer)
    succeeded(*resumed)
    succeeded("run", "../mine.toml", "--out", "whole", *longer)
    one, other = (Result.load(folder).dataset for folder in (here / "out", Path("whole")))
    np.testing.assert_array_equal(one["position"], other["position"])
    # nor is a file that has changed since passed over
    with (here / "a.nc").open("ab") as file:
        file.write(b"\0")
    digest = hashlib.sha256((here / "a.nc").read_bytes()).hexdigest()
    assert result.digests[str(here / "a.nc")] != digest
    text = f"crinoid: --resume: {here / 'a.nc'} changed since the run in ../out started"
    assert refused(*resumed).startswith(text)


@pytest.mark.slow
@pytest.mark.parametrize(("most", "readings"), [(10**9, 2), (0, 4)])
def test_cases_are_run_with_the_records_of_their_checks_as_far_as_these_fit(
    here, monkeypatch, most, readings
):
    class Reader(Player):
        def __call__(self, prepared, **options):
            assert list(prepared.recordings) == [0]
            return super().__call__(prepared, **options)

    write(here, "measured", '[vary]\n"arm.length" = [0.4, 0.5]')
    opened = counted(monkeypatch, "crinoid.recording.selection.read_dataset")
    monkeypatch.setattr("crinoid.cli.run.play", Reader())
    monkeypatch.setattr("crinoid.cli.study._MOST_HELD", most)
    succeeded("run", "mine.toml", "--out", "out")
    assert len(opened) == readings


# --- what comes with the package ---------------------------------------------------------------


def test_the_record_that_comes_along_is_the_one_its_script_makes():
    script = load_script(ROOT / "docs" / "make_tidal_record.py")
    made = script.synthetic(script.SEED)
    assert script.deviates(made) < 0.1
    with xr.open_dataset(script.RECORD, decode_times=False) as stored:
        for name, series in made.items():
            np.testing.assert_allclose(stored[name], series, atol=1e-6)
    played = Scenario(flow=[{"kind": "measured", "file": str(script.RECORD)}])
    assert Prepared(played).notes() == []


def test_the_sea_that_comes_along_is_the_one_its_script_makes():
    script = load_script(ROOT / "docs" / "make_buoy_record.py")
    assert script.RECORD.read_text("utf-8") == script.record()


def test_a_built_in_scenario_brings_its_file_along(here, monkeypatch):
    folder = here / "library"
    folder.mkdir()
    (here / "a.nc").rename(folder / "a.nc")
    (folder / "channel.toml").write_text(f"title = 'Channel'\n[[flow]]\n{KINDS['measured']}\n")
    monkeypatch.setattr(library, "_LIBRARY", folder)
    monkeypatch.setattr(library, "_FOLDER", folder)
    assert builtin_names() == ["channel"]
    assert load("channel").flow[0].file == str(folder / "a.nc")
    succeeded("scenarios", "--copy", "channel")
    assert (here / "a.nc").read_bytes() == (folder / "a.nc").read_bytes()
    assert load("./channel.toml").flow[0].file == str(here / "a.nc")
