"""Waves of measured seas: the elevation at a gauge, and spectra of all layouts."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr

import crinoid
from crinoid.assembly.arrays import build_flow
from crinoid.assembly.prepared import Prepared
from crinoid.flow.waves import jonswap
from crinoid.numerics.sea_statistics import SeaStatistics
from crinoid.recording import at_gauge
from crinoid.scenario import Scenario
from helpers.refusals import mistake, refusal

HEIGHT, PERIOD, GRAVITY = 2.0, 8.0, 9.81


def waves(dimension=3, duration=60.0, depth=None, flows=(), seed=0, **table):
    return Scenario(
        seed=seed,
        arm={"dimension": dimension, "nodes": 5},
        base={"position": [0.0] * (dimension - 1) + [-4.0]},
        water={} if depth is None else {"depth": depth},
        flow=[{"kind": "waves", **table}, *flows],
        simulation={"duration": duration},
    )


# --- an elevation ---------------------------------------------------------------------------------


class Truth:
    """Deep-water waves along x of incommensurate frequencies, up to four times that of the peak."""

    def __init__(self, count=300, seed=1):
        random = np.random.default_rng(seed)
        relative = 0.5 + 3.4 * (np.arange(count) + random.random(count)) / count
        density = jonswap(relative, 3.3)
        self.amplitude = HEIGHT / 4 * np.sqrt(2 * density / density.sum())
        self.rate, self.phase = 2 * np.pi * relative / PERIOD, 2 * np.pi * random.random(count)
        self.number = self.rate**2 / GRAVITY

    def angle(self, time, x):
        return self.number * x - self.rate * np.asarray(time)[..., None] + self.phase

    def elevation(self, time, x=0.0):
        return np.cos(self.angle(time, x)) @ self.amplitude

    def velocity(self, time, x, z):
        size, angle = self.amplitude * self.rate * np.exp(self.number * z), self.angle(time, x)
        return np.stack([np.cos(angle) @ size, np.sin(angle) @ size], axis=-1)


TRUTH = Truth()


def written(path, time, values, units="m"):
    rows = (f"{t:.6f},{value:.8f}" for t, value in zip(time, values, strict=True))
    path.write_text("\n".join([f"t (s),eta ({units})", *rows]) + "\n")
    return {"file": str(path), "time": "t", "value": "eta"}


def components(case):
    """Return what was read of the first flow, and its elevation at times of the run."""
    sea = Prepared(case).seas[0]
    return sea, lambda time: at_gauge(time, *sea.given.values())


@pytest.mark.parametrize(
    ("first", "last", "run", "skip", "step"),
    [(0, 300, 300, 0, 0.5), (0, 900, 120, 400, 0.5), (20, 400, 200, 25, 0.2)],
)
def test_the_elevation_at_the_gauge_is_that_of_the_record(tmp_path, first, last, run, skip, step):
    time = np.arange(first, last + step / 2, step)
    table = written(tmp_path / "a.csv", time, 100 * TRUTH.elevation(time) + 30, "cm")
    cut = 3.9 / PERIOD + 0.01  # all of it
    case = waves(duration=float(run), elevation=table | {"skip": float(skip), "cut_hz": cut})
    sea, elevation = components(case)
    instants = np.linspace(0.0, run, 997)  # between the samples too
    away = elevation(instants) - TRUTH.elevation(instants + skip)
    assert np.abs(away).max() < 1e-3 * HEIGHT
    assert np.abs(sea.given["amplitudes"]).max() < 0.5 * HEIGHT  # no pair cancels out
    assert sea.given["amplitudes"].size < 600
    assert "its mean of 0.3 m is left out" in sea.notes[-2]
    assert "components up to 0.497 Hz differ from it by" in sea.notes[-1]


def test_a_swell_does_not_cut_off_the_wind_sea(tmp_path):
    time = np.arange(0.0, 400.0, 0.25)
    eta = np.cos(2 * np.pi * time / 12.1) + 0.4 * np.cos(2 * np.pi * time / 2.3)
    _, elevation = components(waves(elevation=written(tmp_path / "a.csv", time, eta)))
    away = elevation(time[:240]) - eta[:240]
    assert away.std() < 0.001**0.5 * eta.std()  # less than a thousandth of the variance


def test_the_water_below_the_gauge_moves_as_in_the_true_sea(tmp_path):
    time = np.arange(0.0, 400.0, 0.5)
    table = written(tmp_path / "a.csv", time, TRUTH.elevation(time, x=5.0))
    table |= {"position": [5.0], "skip": 120.0, "cut_hz": 0.5}
    flow = crinoid.system(waves(2, 100.0, elevation=table)).forces.water.flows[0]
    instants, places = np.linspace(0.0, 100.0, 41), [(5.0, 0.0), (5.0, -6.0), (-8.0, -3.0)]
    found = jax.jit(jax.vmap(jax.vmap(flow.velocity, (None, 0)), (0, None)))(
        jnp.asarray(places), jnp.asarray(instants)
    )
    for (x, z), velocity in zip(places, found, strict=True):
        truth = TRUTH.velocity(instants + 120.0, x, z)
        assert np.abs(velocity - truth).max() < 0.005 * np.abs(truth).max()


def test_gaps_and_uneven_times_are_filled_as_the_sea_probably_was(tmp_path):
    random = np.random.default_rng(3)
    time = np.arange(0.0, 300.0, 0.5) + random.uniform(-0.1, 0.1, 600)
    time[0] = 0.0
    time = time[(time < 100) | (time > 103)]
    table = written(tmp_path / "a.csv", time, TRUTH.elevation(time)) | {"skip": 50.0}
    sea, elevation = components(waves(duration=150.0, elevation=table | {"cut_hz": 0.5}))
    away = elevation(time[(time > 50) & (time < 200)] - 50) - TRUTH.elevation(
        time[(time > 50) & (time < 200)]
    )
    assert np.abs(away).max() < 0.02 * HEIGHT
    assert np.abs(elevation(np.array([51.5])) - TRUTH.elevation([101.5])) < 0.3 * HEIGHT
    assert any(note.startswith("samples are 0.3") for note in sea.notes)


def test_what_is_above_the_cut_is_said_and_a_tide_too(tmp_path):
    time = np.arange(0.0, 400.0, 0.5)
    values = TRUTH.elevation(time) + 1.5 * np.sin(2 * np.pi * time / 3000)
    table = written(tmp_path / "a.csv", time, values) | {"skip": 100.0, "cut_hz": 0.2}
    sea, _ = components(waves(duration=200.0, elevation=table))
    above = TRUTH.rate > 2 * np.pi * 0.2
    share = np.sum(TRUTH.amplitude[above] ** 2) / np.sum(TRUTH.amplitude**2)
    said = float(sea.notes[-2].rpartition("; ")[2].partition("%")[0]) / 100
    assert 0.5 * share < said < 1.2 * share
    assert "of its variance is slower than" in sea.notes[-1]
    assert sea.given["frequencies"].max() <= 2 * np.pi * 0.2


def test_spreading_and_a_seed_leave_the_elevation_at_the_gauge(tmp_path):
    time = np.arange(0.0, 200.0, 0.5)
    table = written(tmp_path / "a.csv", time, TRUTH.elevation(time))
    table |= {"position": [3.0, -2.0], "skip": 60.0}
    case = waves(duration=60.0, elevation=table, spreading=8.0, direction_deg=30.0)
    _, elevation = components(case)
    flows = [
        crinoid.system(case.with_values({"seed": seed})).forces.water.flows[0] for seed in (0, 1)
    ]
    assert np.abs(flows[0].headings - flows[1].headings).max() > 0.1
    instants = np.linspace(0.0, 60.0, 13)
    surface = jax.jit(
        jax.vmap(lambda flow, point, now: flow.elevation(point, now), (None, None, 0))
    )
    for flow in flows:
        found = surface(flow, jnp.asarray([3.0, -2.0, 0.0]), jnp.asarray(instants))
        np.testing.assert_allclose(found, elevation(instants), atol=1e-9)
    turn = np.arctan2(*(flows[0].mean_heading[::-1]))
    assert np.rad2deg(turn) == pytest.approx(30.0, abs=4.0)


@pytest.mark.parametrize(
    ("change", "line"),
    [
        ({"skip": 170.0}, "time: ends at 29.5 s of the run; must end at simulation.duration"),
        ({"cut_hz": 1.0}, "cut_hz: got 1.0; must be below 1 (Hz), half the rate of the record"),
        ({"cut_hz": 0.01}, "cut_hz: got 0.01; must be above those of the longest waves"),
        ({"value": "height"}, 'value: got "height", no such column in a.csv'),
        ({"time": "eta"}, 'time: eta is in "m"; must be in a unit'),
    ],
)
def test_an_elevation_that_does_not_fit_is_refused(tmp_path, change, line):
    time = np.arange(0.0, 200.0, 0.5)
    table = written(tmp_path / "a.csv", time, TRUTH.elevation(time)) | change
    assert refusal(waves(elevation=table)).startswith(f"flow.0.elevation.{line}")


def test_still_water_is_no_elevation(tmp_path):
    table = written(tmp_path / "a.csv", np.arange(200.0), np.full(200, 0.5))
    line = "flow.0.elevation.value: eta has 200 samples from 0.5 to 0.5 m; must have 16 or more"
    assert refusal(waves(elevation=table)) == f"{line} that differ"


# --- a spectrum -----------------------------------------------------------------------------------

FREQUENCY = np.linspace(0.05, 0.5, 91)
DENSITY = jonswap(FREQUENCY * PERIOD, 3.3)
DENSITY *= (HEIGHT / 4) ** 2 / np.trapezoid(DENSITY, FREQUENCY)
TO = np.arange(0.0, 360.0, 15.0)
TOWARD, S = 60.0, 12.0
SHAPE = np.abs(np.cos(np.deg2rad(TO - TOWARD) / 2)) ** (2 * S)
SHAPE /= SHAPE.sum() * np.deg2rad(15.0)
"""Share of the energy by the compass direction of travel (1/rad)."""
SPREAD = np.sqrt(2 / (1 + S))
"""Of cos-2s (rad): its first harmonic is s / (1 + s)."""
PER_RAD, PER_DEG = {"units": "m2 s rad-1"}, {"units": "m2 s degree-1"}
HZ, DEGREE = {"units": "Hz"}, {"units": "degree"}


def way(which):
    return DEGREE | {"standard_name": f"sea_surface_wave_{which}_direction"}


def wavewatch():
    """Return the layout of WAVEWATCH III, its directions not in order."""
    efth = np.outer(DENSITY, SHAPE)[None, None, :, ::-1]
    return xr.Dataset(
        {"efth": (("time", "station", "frequency", "direction"), efth, PER_RAD)},
        {
            "time": ("time", [12423.25], {"units": "days since 1990-01-01"}),
            "station": [1],
            "frequency": ("frequency", FREQUENCY, {"units": "s-1"}),
            "direction": ("direction", TO[::-1], way("to")),
        },
    )


def wavespectra():
    """Return the layout of wavespectra, with 0 and 360 degrees and two times."""
    came = np.append(np.mod(TO + 180, 360), 180.0 + 360.0)
    efth = np.outer(DENSITY, np.append(SHAPE, SHAPE[0])) * np.pi / 180
    order = np.argsort(np.mod(came, 360.0 + 1e-9), kind="stable")
    return xr.Dataset(
        {"efth": (("time", "freq", "dir"), np.stack([efth, 4 * efth])[..., order], PER_DEG)},
        {
            "time": ("time", [0.0, 3600.0], {"units": "seconds since 2020-01-01"}),
            "freq": ("freq", FREQUENCY, HZ),
            "dir": ("dir", np.mod(came, 360.0)[order], way("from")),
        },
    )


def ndbc():
    """Return the layout of NDBC: harmonics of the directions that the waves come from."""
    dims, shape = ("time", "frequency", "latitude", "longitude"), (1, FREQUENCY.size, 1, 1)
    r1, r2 = S / (S + 1), S * (S - 1) / ((S + 1) * (S + 2))
    columns = {
        "spectral_wave_density": (DENSITY, "(meter * meter)/Hz"),
        "mean_wave_dir": (TOWARD + 180, "degrees_true"),
        "principal_wave_dir": (TOWARD, "degrees_true"),
        "wave_spectrum_r1": (r1, "1"),
        "wave_spectrum_r2": (r2, "1"),
    }
    return xr.Dataset(
        {
            name: (dims, np.ones(shape) * np.reshape(values, (1, -1, 1, 1)), {"units": units})
            for name, (values, units) in columns.items()
        },
        {"time": [0], "frequency": ("frequency", FREQUENCY, HZ), "latitude": [40.0],
         "longitude": [-70.0]},
    )  # fmt: skip


def drawn(case, sea, seed):
    """Return the statistics of the waves that a seed draws."""
    flow = case.flow[0].build(case, np.random.default_rng(seed), sea)
    order = np.argsort(flow.frequencies)
    headings = np.asarray(flow.headings)[order]
    return SeaStatistics.of(
        np.asarray(flow.frequencies)[order] / (2 * np.pi),
        np.square(flow.amplitudes)[order] / 2,
        np.arctan2(headings[:, 1], headings[:, 0]),
    )


@pytest.mark.parametrize(
    ("file", "keys", "scale"),
    [(wavewatch, {}, 1), (wavespectra, {"select": {"time": 3500.0}}, 2), (ndbc, {}, 1)],
)
def test_a_hundred_draws_have_the_statistics_of_the_file(file, keys, scale):
    # x points to the north-east: the waves travel 15 degrees to its right
    case = waves(spectrum={"file": file(), "heading_deg": 45.0, **keys})
    sea = Prepared(case).seas[0]
    found = sea.statistics
    assert found.height == pytest.approx(scale * HEIGHT, rel=1e-6)
    assert found.peak_period == pytest.approx(PERIOD, rel=0.01)
    assert found.direction == pytest.approx(np.deg2rad(45.0 - TOWARD), abs=1e-6)
    assert found.spreading == pytest.approx(SPREAD, rel=0.005)
    draws = np.array([drawn(case, sea, seed) for seed in range(100)])
    np.testing.assert_allclose(draws[:, 0], found.height, rtol=1e-6)
    mean = draws.mean(axis=0)
    np.testing.assert_allclose(mean[[1, 2, 4]], [found[1], found[2], found[4]], rtol=0.02)
    assert mean[3] == pytest.approx(found.direction, abs=0.02 * SPREAD)


def test_a_spectrum_of_frequency_alone_spreads_as_asked(tmp_path):
    path = tmp_path / "s.csv"
    pairs = zip(FREQUENCY, 1e4 * DENSITY, strict=True)
    rows = "\n".join(f"{f:.6f},{density:.6f}" for f, density in pairs)
    path.write_text(f"frequency (Hz),S (cm2/Hz)\n{rows}\n")
    case = waves(spectrum={"file": str(path)}, spreading=S, direction_deg=-15.0)
    sea = Prepared(case).seas[0]
    assert sea.statistics.height == pytest.approx(HEIGHT, rel=1e-4)
    assert sea.notes == (
        f"s.csv: {sea.statistics}, from 0.05 to 0.5 Hz",
    )  # fmt: skip
    mean = np.mean([drawn(case, sea, seed) for seed in range(100)], axis=0)
    assert mean[1] == pytest.approx(PERIOD, rel=0.02)
    assert mean[4] == pytest.approx(SPREAD, rel=0.02)
    # an arm in the plane meets the cut
    flat = build_flow(
        waves(2, spectrum={"file": str(path)}, direction_deg=60.0), 0, case.flow[0], sea
    )
    assert flat.headings.shape == (64, 1)


def test_directions_turn_by_from_and_by_the_heading():
    def direction(**keys):
        sea = Prepared(waves(spectrum={"file": wavewatch(), **keys})).seas[0]
        return np.rad2deg(sea.statistics.direction)

    assert direction(heading_deg=0.0) == pytest.approx(-60.0)  # to the right of north
    assert direction(heading_deg=90.0) == pytest.approx(30.0)  # to the left of east
    assert direction(heading_deg=90.0, direction_is="from") == pytest.approx(-150.0)


def test_a_current_stops_a_part_of_a_spectrum():
    against = [{"kind": "uniform", "velocity": [-1.5, 0.0, 0.0]}]
    case = waves(
        flows=against, spectrum={"file": wavewatch(), "heading_deg": TOWARD}, components=500
    )
    flow = Prepared(case).parameters.flow[0]
    assert flow.amplitudes.size < 500
    assert 4 * flow.deviation == pytest.approx(HEIGHT, rel=1e-6)
    along = -1.5 * np.asarray(flow.headings)[:, 0]
    assert np.all(4 * flow.frequencies * -along < GRAVITY * (1 + 1e-9))


def test_a_current_that_stops_all_waves_of_a_file_is_refused():
    against = [{"kind": "uniform", "velocity": [-50.0, 0.0, 0.0]}]
    table = {"file": wavewatch(), "heading_deg": TOWARD}
    case = Prepared(waves(flows=against, spectrum=table))
    line = mistake(lambda: case.parameters)
    assert line.startswith("flow.0.spectrum.file: ")
    assert line.endswith("the mean current of 50 m/s stops all waves; must be slower, or absent")


def without(*names):
    return lambda data: data.drop_vars(names)


def told(name, **attributes):
    def change(data):
        data[name].attrs = attributes
        return data

    return change


@pytest.mark.parametrize(
    ("file", "change", "keys", "line"),
    [
        (wavespectra, None, {}, "spectrum.density: efth also has a dimension time (0 to 3600)."),
        (wavewatch, None, {}, "spectrum.heading_deg: missing; must be the compass heading of x"),
        (wavewatch, told("direction", units="degree"), {"heading_deg": 0.0},
         'spectrum.direction_is: missing; must be "to" or "from", as waves travel.'),
        (wavewatch, told("efth"), {"heading_deg": 0.0}, "spectrum.density: efth names no unit;"),
        (wavewatch, told("efth", units="m2 s"), {"heading_deg": 0.0},
         'spectrum.density: efth is in "m2 s"; must be in a unit such as m2 s rad-1'),
        (wavewatch, told("frequency", units="rad s-1"), {"heading_deg": 0.0},
         'spectrum.frequency: frequency is in "rad s-1"; must be in a unit such as Hz'),
        (wavewatch, lambda data: -data, {"heading_deg": 0.0}, "spectrum.density: efth "),
        (wavewatch, without("efth"), {}, "spectrum.density: "),
        (ndbc, without("mean_wave_dir"), {"heading_deg": 0.0},
         "spectrum.heading_deg: got 0.0; must be left out: spectral_wave_density has no "),
        (ndbc, lambda data: data.where(data.frequency > 0.1), {"heading_deg": 0.0},
         "spectrum.density: spectral_wave_density lacks 11 of 91 values; must have all"),
    ],
)  # fmt: skip
def test_a_spectrum_that_does_not_fit_is_refused(file, change, keys, line):
    with xr.set_options(keep_attrs=True):
        data = file() if change is None else change(file())
    assert refusal(waves(spectrum={"file": data, **keys})).startswith(f"flow.0.{line}")


def test_a_direction_beside_those_of_a_file_is_refused():
    case = waves(spectrum={"file": wavewatch(), "heading_deg": 0.0}, direction_deg=20.0)
    line = refusal(case)
    assert line.startswith("flow.0.direction_deg: got 20.0; must be left out: ")
    assert line.endswith(".nc has directions")


def test_one_component_is_the_wave_of_linear_theory(tmp_path):
    rate, number = 2 * np.pi / 8.0, (2 * np.pi / 8.0) ** 2 / GRAVITY
    time = np.arange(0.0, 160.0, 0.5)
    table = written(tmp_path / "a.csv", time, 0.5 * np.cos(rate * time - 1.0))
    case = waves(2, 40.0, elevation=table | {"skip": 60.0, "cut_hz": 0.3})
    flow = crinoid.system(case).forces.water.flows[0]
    found = flow.velocity(jnp.asarray([2.0, -3.0]), jnp.asarray(20.0))
    angle = number * 2.0 - rate * 80.0 + 1.0
    size = 0.5 * rate * np.exp(-3.0 * number)
    np.testing.assert_allclose(
        found, [size * np.cos(angle), size * np.sin(angle)], atol=2e-3 * size
    )


def test_files_in_tables_are_found_beside_the_scenario_and_have_digests(tmp_path):
    time = np.arange(0.0, 200.0, 0.5)
    written(tmp_path / "a.csv", time, TRUTH.elevation(time))
    path = tmp_path / "case.toml"
    path.write_text(
        '[[flow]]\nkind = "waves"\nelevation = {file = "a.csv", time = "t", value = "eta"}\n'
    )
    prepared = Prepared(crinoid.load(path))
    assert [*prepared.digests] == [str(tmp_path / "a.csv")]
    assert prepared.seas[0].name == "a.csv"
    varied = crinoid.load(path, ["vary={'flow.0.elevation.file' = ['a.csv', 'b.csv']}"])
    assert len(varied.cases()) == 2
