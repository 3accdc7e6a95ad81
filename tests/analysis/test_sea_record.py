"""A record of the sea by itself: its numbers against known answers, and `crinoid flow FILE`."""

import csv
import re

import numpy as np
import pytest
import xarray as xr

from crinoid.analysis.sea_record import (
    histogram,
    principal,
    record_dataset,
    record_spectrum,
    record_statistics,
    scatter,
    tide,
    turbulence_intensity,
)
from crinoid.flow.waves import jonswap
from crinoid.numerics.signals_and_systems import von_karman
from crinoid.recording.series import FilledRecord
from crinoid.scenario import Scenario
from crinoid.view.figures import write_report
from helpers.command import refused, succeeded
from helpers.figures import assert_shows_something

EARTH = ("east", "north", "up")


def recorded(time, *parts, filled=(), levels=None):
    """Return a record at one point, or with the same velocity at all levels."""
    velocity = np.stack([np.broadcast_to(part, time.shape) for part in parts], axis=1)
    count = 1 if levels is None else len(levels)
    lacking = np.zeros((time.size, count), bool)
    lacking[list(filled)] = True
    velocity = np.repeat(velocity[:, None], count, axis=1)
    heights = None if levels is None else np.array(levels)
    return FilledRecord(time, heights, velocity, lacking, [])


def random_series(density, time, frequency):
    """Return a series of a spectral density at frequencies, with random phases."""
    random = np.random.default_rng(2)
    step = frequency[1] - frequency[0]
    waves = np.sqrt(2 * density * step)
    phases = random.uniform(0, 2 * np.pi, frequency.size)
    return np.cos(2 * np.pi * np.outer(time, frequency) + phases) @ waves


# --- numbers -----------------------------------------------------------------------------------


def test_statistics_are_of_the_measured_values_alone():
    time = np.arange(0.0, 1000.0)
    swing = np.sin(2 * np.pi * time / 100)
    holes = [*range(200, 210), *range(500, 530)]
    east = np.where(np.isin(time, holes), 40.0, 0.5 + 0.3 * swing)  # as if filled badly
    found = record_statistics(recorded(time, east, 0.0, 0.0, filled=holes), 0, EARTH)
    measured = np.delete(east, holes)
    assert found["mean east, north, up (m/s)"] == pytest.approx([measured.mean(), 0.0, 0.0])
    assert found["deviation east, north, up (m/s)"] == pytest.approx([measured.std(), 0.0, 0.0])
    assert found["largest speed (m/s)"] == pytest.approx(0.8)
    assert found["median speed (m/s)"] == pytest.approx(np.median(measured))
    assert (found["gaps"], found["longest gap (s)"]) == (2, 31.0)  # from 499 to 530 s
    assert found["missing (%)"] == pytest.approx(4.0)
    assert "turbulence intensity (%)" not in found  # samples are 1 s apart


@pytest.mark.parametrize("towards", [30.0, 200.0])
def test_the_principal_direction_is_that_of_the_ebb_and_flood(towards):
    time = np.arange(0, 50 * 44714.0, 600.0)
    along, across = 0.1 + np.sin(2 * np.pi * time / 44714.0), 0.2 * np.cos(time)
    sine, cosine = np.sin(np.deg2rad(towards)), np.cos(np.deg2rad(towards))
    record = recorded(time, along * sine + across * cosine, along * cosine - across * sine, 0.0)
    found = record_statistics(record, 0, EARTH)
    assert found["principal direction (deg)"] == pytest.approx(towards, abs=0.5)
    expected = np.mean(along**2) / np.mean(along**2 + across**2)
    assert found["mean square along it (%)"] == pytest.approx(100 * expected, abs=0.1)
    # without a compass it counts from x towards y
    found = record_statistics(record, 0, ("x", "y", "z"))
    assert np.cos(np.deg2rad(found["principal direction (deg)"] + towards - 90)) > 0.999
    assert principal(record.velocity[:, 0, ::2]) == (0.0, 1.0)  # the plane of an arm


def test_the_turbulence_intensity_is_that_of_windows_of_ten_minutes():
    time = np.arange(0, 2400, 0.5)
    fast = 0.1 * np.sqrt(2) * np.sin(2 * np.pi * time / 10)
    slow = 1.0 + 0.2 * (time // 600)  # a tide that is no turbulence
    found = turbulence_intensity(recorded(time, 0.6 * (slow + fast), 0.8 * (slow + fast), 0.0), 0)
    np.testing.assert_allclose(found, 0.1 / np.array([1.0, 1.2, 1.4, 1.6]), rtol=1e-6)
    # a window with gaps is left out
    found = turbulence_intensity(recorded(time, slow + fast, 0.0, filled=range(1300, 1400)), 0)
    np.testing.assert_allclose(found, 0.1 / np.array([1.0, 1.4, 1.6]), rtol=1e-6)


def test_a_histogram_adds_up_and_has_the_mean():
    speed = np.repeat([0.05, 0.12, 0.31, 1.0], [10, 20, 40, 30])
    centres, shares = histogram(speed)
    np.testing.assert_allclose(np.diff(centres), 0.05)
    assert shares.sum() == pytest.approx(1.0)
    known = dict(zip(centres.round(3).tolist(), shares.tolist(), strict=True))
    assert (known[0.075], known[0.125], known[0.325], known[1.025]) == (0.1, 0.2, 0.4, 0.3)
    assert centres @ shares == pytest.approx(speed.mean(), abs=0.025)
    first, *others = histogram(np.zeros(5))[1]
    assert (first, any(others)) == (1.0, False)


def test_a_scatter_diagram_has_the_occupied_bins():
    # widths of 0.5 and 1: the largest of 1, 2, 5 times a power of ten with six bins
    states = np.array([[0.5, 6.0], [0.9, 6.9], [0.49, 6.0], [3.2, 9.9], [0.7, 6.2]])
    centres, shares = scatter(states)
    np.testing.assert_allclose(centres, [[0.25, 6.5], [0.75, 6.5], [3.25, 9.5]])
    np.testing.assert_allclose(shares, [0.2, 0.6, 0.2])
    np.testing.assert_allclose(scatter(np.array([[0.6], [1.3]]))[0], [[0.7], [1.3]])  # no round-off


def test_the_spectrum_has_the_period_and_the_variance_of_a_sine():
    time = np.arange(0, 40_000, 10.0)
    sine = 0.3 * np.sin(2 * np.pi * time / 500)
    record = recorded(time, 0.6 * (1 + sine), 0.8 * (1 + sine), 0.0)
    found, model, _ = record_spectrum(record, 0)
    along = found.density[:, 0]
    assert found.frequency[np.argmax(along)] == pytest.approx(1 / 500, rel=0.03)
    assert along.sum() * found.frequency[0] == pytest.approx(0.3**2 / 2, rel=0.02)
    assert found.density[:, 1:].max() < 1e-9 * along.max()
    assert model is None  # slow


def test_turbulence_has_the_model_of_von_karman_and_waves_that_of_a_sea():
    time = np.arange(0, 1200, 0.25)
    frequency = np.linspace(1 / 1200, 1.9, 2000)
    eddies = random_series(von_karman(frequency, 0.1, 5.0, 1.0), time, frequency)
    found, model, name = record_spectrum(recorded(time, 1.0 + eddies, 0.0), 0)
    assert name.startswith("von Karman")
    middle = (found.frequency > 0.05) & (found.frequency < 1.0)
    ratio = found.density[middle, 0].sum() / model[middle].sum()
    assert ratio == pytest.approx(1.0, abs=0.3)

    band = frequency[frequency > 0.05]
    sea = jonswap(band / 0.1, 3.3) * band**2 * np.exp(-2 * (2 * np.pi * band) ** 2 / 9.81 * 5.0)
    sea *= 0.04 / (sea.sum() * (band[1] - band[0]))
    swell = random_series(sea, time, band)
    found, model, name = record_spectrum(recorded(time, 0.1 + swell, 0.0, levels=[-5.0]), 0)
    assert name.startswith("JONSWAP")
    assert found.frequency[np.argmax(model)] == pytest.approx(0.1, rel=0.15)
    ratio = model[found.frequency > 0.15].sum() / found.density[found.frequency > 0.15, 0].sum()
    assert ratio == pytest.approx(1.0, abs=0.4)


M2, K1 = 12.4206012 * 3600, 23.93447213 * 3600


@pytest.mark.parametrize("dated", [False, True])
def test_the_tide_has_the_constituents_of_which_it_is_made(dated):
    pytest.importorskip("utide", reason="needs utide")
    time = np.arange(0, 30 * 86400, 300.0)
    noise = 0.05 * np.random.default_rng(3).normal(size=time.size)
    flood = 1.2 * np.cos(2 * np.pi * time / M2 - 1.0) + 0.3 * np.cos(2 * np.pi * time / K1 - 2.0)
    record = recorded(time, 0.1 + 0.8 * flood, 0.6 * flood + noise, 0.0, filled=range(500, 700))
    start = np.datetime64("2024-03-01") if dated else None
    found = tide(record, 0, start, None)
    assert found.names[:2] == ["M2", "K1"]
    np.testing.assert_allclose(found.amplitude[:2], [1.2, 0.3], atol=0.01)
    if not dated:  # lags of the first sample
        np.testing.assert_allclose(found.phase[:2], np.rad2deg([1.0, 2.0]), atol=1.0)
    variance = (0.8**2 + 0.6**2) * (1.2**2 + 0.3**2) / 2
    # means of ten minutes halve the variance of noise that differs from sample to sample
    assert found.share == pytest.approx(variance / (variance + 0.05**2 / 2), abs=1e-3)


DAY, S2 = 86400.0, 43200.0
FORTNIGHT = 1 / (1 / S2 - 1 / M2)
"""Period (s) of spring and neap tide, that of the constituent MSF."""
SAMPLED = {
    "days, of spring and neap": (np.arange(400) * DAY, FORTNIGHT, "MSF"),
    "six hours": (np.arange(240) * DAY / 4, M2, "M2"),
    "hours": (np.arange(720) * DAY / 24, M2, "M2"),
    "hours with gaps": (np.delete(np.arange(720), np.r_[200:260, 500:530]) * DAY / 24, M2, "M2"),
    "hours of the day alone": (np.arange(1440)[np.arange(1440) % 24 < 9] * DAY / 24, M2, "M2"),
}


@pytest.mark.parametrize(("time", "period", "name"), SAMPLED.values(), ids=SAMPLED)
def test_a_tide_has_no_constituent_that_its_samples_cannot_tell_from_others(time, period, name):
    pytest.importorskip("utide", reason="needs utide")
    noise = 0.02 * np.random.default_rng(3).normal(size=time.size)
    east = 0.2 + 0.5 * np.cos(2 * np.pi * time / period) + noise
    found = tide(recorded(time, east, 0.0, 0.0), 0, None, None)
    assert found.names[0] == name
    assert found.amplitude[0] == pytest.approx(0.5, abs=0.02)
    assert found.amplitude[1:].max() < 0.02
    assert found.share == pytest.approx(1 - 0.02**2 / np.var(east), abs=2e-3)


@pytest.mark.parametrize("speed", [0.0, 0.3])
def test_a_steady_record_has_no_tide_and_no_model(speed):
    pytest.importorskip("utide", reason="needs utide")
    found = tide(recorded(np.arange(720) * 3600.0, speed, 0.0, 0.0), 0, None, None)
    assert (found.names, found.amplitude.size) == ([], 0)
    assert np.isnan(found.share)
    assert record_spectrum(recorded(np.arange(480) / 8, speed, 0.0), 0)[1] is None


def test_without_a_mean_no_intensity_is_defined():
    time = np.arange(0, 600, 0.5)
    swing = recorded(time, 1e-4 + np.sin(2 * np.pi * time / 10), 0.0)
    assert np.isnan(turbulence_intensity(swing, 0)).all()
    assert np.isnan(record_statistics(swing, 0, ("x", "z"))["turbulence intensity (%)"])


def test_a_profile_has_the_speed_of_each_level_in_order_of_height():
    time = np.arange(0.0, 500.0)
    record = recorded(time, 0.5, 0.0, levels=[-2.0, -4.0, -6.0])
    record.velocity[:, :, 0] = 0.1 * np.arange(3) + time[:, None] / 500
    data = record_dataset(record, 1, ("x", "z"))
    assert data["height"].values.tolist() == [-6.0, -4.0, -2.0]
    np.testing.assert_allclose(data["speed_mean"], np.array([0.2, 0.1, 0.0]) + 0.499)
    np.testing.assert_allclose(data["speed_high"] - data["speed_low"], 0.9 * 499 / 500)
    assert data.attrs["height"] == -4.0


# --- the command -------------------------------------------------------------------------------


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    time, depth = np.arange(0, 300, 0.5), np.array([2.0, 5.0, 9.0])
    random = np.random.default_rng(0)
    east = 0.5 - 0.02 * depth + 0.05 * random.normal(size=(time.size, 3))
    east[40:45] = np.nan
    unit = {"units": "m/s"}
    known = {"standard_name": "eastward_sea_water_velocity"}
    xr.Dataset(
        {
            "uo": (("time", "depth"), east, unit | known),
            "vo": (("time", "depth"), 0 * east + 0.1, unit),
            "uo_qc": (("time", "depth"), np.ones(east.shape, np.int8)),
            "temperature": ("time", 0 * time, {"units": "degree_C"}),
        },
        {
            "time": ("time", time, {"units": "seconds since 2024-03-01"}),
            "depth": ("depth", depth, {"units": "m", "positive": "down"}),
        },
    ).to_netcdf(tmp_path / "sea.nc")
    rows = [f"{at:g},{0.3 + 0.1 * np.sin(at):.4f},0.0" for at in range(100)]
    (tmp_path / "pier.csv").write_text("\n".join(["time (s),u (m/s),w (m/s)", *rows]))
    return tmp_path


def test_a_profile_is_summed_up_and_drawn(here):
    written = succeeded("flow", "sea.nc")
    assert "299.5 s from 2024-03-01T00:00:00, 600 samples each 0.5 s (2 Hz)" in written
    assert "levels z (m): -9, -5, -2" in written
    folder = here / "results" / "sea-flow"
    files = ["histogram.csv", "record.nc", "record.png"]
    assert sorted(path.name for path in folder.iterdir()) == files
    assert [path.name for path in write_report(folder)] == ["record.png"]
    assert_shows_something(folder / "record.png")
    with xr.open_dataset(folder / "record.nc", decode_times=False) as data:
        assert all(data[name].attrs["units"] for name in data.data_vars)
        assert "model_spectrum" in data
        assert "missing" in data.attrs["notes"]
    with (folder / "histogram.csv").open() as stream:
        table = [[float(cell) for cell in row] for row in list(csv.reader(stream))[1:]]
    assert np.sum(table, axis=0)[1] == pytest.approx(1.0, abs=1e-4)


@pytest.mark.slow
def test_the_printed_table_plays_the_record(here):
    written = succeeded("flow", "sea.nc", "--set", "flow.0.heading_deg=40")
    table = written[written.index("[[flow]]") :].partition("\n\n")[0]
    text = f"{table}\n[simulation]\nduration = 1.0\n"
    (flow,) = Scenario.from_toml(text).flow
    assert (flow.vertical, flow.heading_deg) == ("depth", 40.0)
    (here / "mine.toml").write_text(text)
    assert "flow.0: sea.nc, 299.5 s at 2 Hz" in succeeded("flow", "mine.toml")


def test_a_table_of_one_point_above_a_shallow_bed_is_summed_up(here):
    succeeded("flow", "pier.csv", "--out", "out", "--set", "water.depth=3")
    assert (here / "out" / "record.png").exists()


def test_a_spreadsheet_of_speeds_and_directions_is_summed_up(here):
    rows = [f"01.03.2024 06:{10 * k:02d};1,{k};90" for k in range(5)]
    (here / "buoy.csv").write_text("\n".join(["time;speed (kn);direction (deg)", *rows]))
    written = succeeded("flow", "buoy.csv")
    assert "2400 s from 2024-03-01T06:00:00, 5 samples each 600 s" in written
    assert re.search(rf"mean east, north, up \(m/s\) +│ {1.2 * 1852 / 3600:.3f}", written)
    table = written[written.index("[[flow]]") :].partition("\n\n")[0]
    assert 'speed = "speed"' in table
    played = Scenario.from_toml(f"{table}\n[simulation]\nduration = 1.0\n")
    assert Scenario.from_toml(played.to_toml()) == played


@pytest.mark.filterwarnings("error")
def test_what_a_record_lacks_is_said_and_no_warning_is_left(here):
    rows = "".join(f"{k},0.0,0.0\n" for k in range(400))
    (here / "still.csv").write_text(f"time (hours since 3000-01-01),u (m/s),w (m/s)\n{rows}")
    written = succeeded("flow", "still.csv")
    assert "tide: none, the current is steady" in written
    days = "".join(f"{k},{np.sin(k)},0\n" for k in range(40))
    (here / "days.csv").write_text(f"time (days),u (m/s),w (m/s)\n{days}")
    assert "no constituent with a period below 48 h, two intervals" in succeeded("flow", "days.csv")


@pytest.mark.parametrize("unit", ["s since midnight", "months since 2024-01-01"])
def test_times_without_a_date_and_latitudes_in_words_are_summed_up(here, unit):
    rows = "".join(f"{k},36N,0.{k}\n" for k in range(4))
    (here / "odd.csv").write_text(f"time ({unit}),lat,u (m/s)\n{rows}")
    assert "4 samples each" in succeeded("flow", "odd.csv")


BUOY = """#YY  MM DD hh mm WDIR WSPD  WVHT   DPD   APD MWD
#yr  mo dy hr mn degT m/s     m   sec   sec degT
2024 01 01 00 40 250  5.0  1.10  6.25  5.00 999
2024 01 01 01 40 250  5.0 99.00 99.00 99.00 999
2024 01 01 02 40 250  5.0  1.40  6.67  5.00 999
2024 01 01 03 40 250  5.0  4.10  9.09  7.00 999
2024 01 01 04 40 250  5.0  1.20  6.67    MM 999
"""


def rows_of(file):
    with file.open() as stream:
        head, *rows = csv.reader(stream)
    return head, [[float(cell) for cell in row] for row in rows]


def test_waves_of_a_buoy_become_a_scatter_diagram(here):
    (here / "buoy.txt").write_text(BUOY)
    written = succeeded("flow", "buoy.txt", "--out", "sea")
    assert "1 of 5 rows lack a value and are left out" in written
    assert re.search(r"largest significant height \(m\) +│ 4.1", written)
    head, rows = rows_of(here / "sea" / "scatter.csv")
    assert head == ["flow.0.significant_height", "flow.0.peak_period", "share of time"]
    np.testing.assert_allclose(rows, [[1.25, 6.5, 0.75], [4.25, 9.5, 0.25]])
    # without peak periods their mean ones are those of a JONSWAP spectrum: Tp = 1.286 Tz
    (here / "buoy.txt").write_text(BUOY.replace("DPD", "xxx"))
    written = succeeded("flow", "buoy.txt", "--out", "sea")
    assert "APD is a mean period: peak periods are 1.286 times as long" in written
    assert "2 of 5 rows" in written
    assert rows_of(here / "sea" / "scatter.csv")[1][-1][1] == pytest.approx(9.5)  # 9.002
    (here / "sea" / "scatter.csv").write_text("mine")
    assert "scatter.csv was not written by crinoid" in refused("flow", "buoy.txt", "--out", "sea")
    assert "--set: got" in refused("flow", "buoy.txt", "--set", "water.depth=3")


def test_waves_and_current_of_one_file_have_bins_together(here):
    waves = "sea_surface_wave_significant_height"
    values = {
        "EWCT": ([0.3, 0.4, np.nan, 0.1], {"units": "m s-1"}),
        "NSCT": ([0.4, 0.3, 0.1, 0.0], {"units": "m s-1"}),
        "waves": ([1.2, 1.3, 1.1, 3.1], {"units": "m", "standard_name": waves}),
        "VTPK": ([6.1, 6.2, 6.3, 9.1], {"units": "s"}),
    }
    time = {"TIME": ("TIME", np.arange(4) / 24, {"units": "days since 2024-01-01"})}
    dims = ("TIME", "DEPTH")
    data = {name: (dims, np.array(each)[:, None], about) for name, (each, about) in values.items()}
    xr.Dataset(data, time).to_netcdf(here / "station.nc")
    assert "1 of 4 rows lack a value" in succeeded("flow", "station.nc", "--out", "sea")
    head, rows = rows_of(here / "sea" / "scatter.csv")
    assert head[2:] == ["flow.1.velocity.0", "share of time"]
    np.testing.assert_allclose(
        rows, [[1.25, 6.5, 0.525, 2 / 3], [3.25, 9.5, 0.125, 1 / 3]], rtol=1e-5
    )
    assert (here / "sea" / "histogram.csv").exists()


def test_waves_at_several_places_are_refused(here):
    states = {name: (("time", "lat"), np.ones((3, 2))) for name in ("swh", "pp1d")}
    xr.Dataset(states, {"time": [0.0, 1.0, 2.0]}).to_netcdf(here / "grid.nc")
    assert "swh has dimensions time, lat; must have one dimension" in refused("flow", "grid.nc")
