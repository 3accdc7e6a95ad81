"""Modes of a scenario's arm in each medium: against exact beams, and `crinoid modes`."""

import numpy as np
import pytest
import xarray as xr

import crinoid
from crinoid.dynamics import ModesError
from crinoid.results.dimensionless import bending
from crinoid.scenario import Scenario
from crinoid.view.figures import write_report
from helpers.beams import NATURAL
from helpers.command import refused, succeeded
from helpers.figures import assert_shows_something

LIGHT = {
    "arm": {"nodes": 21, "length": 0.5, "radius": 0.02, "density": 1080.0, "youngs_modulus": 1e6,
            "damping_time": 0.002},
    "water": {"gravity": 0.001},
    "flow": [{"kind": "turbulence", "mean": [0.0, 0.05], "intensity": 0.2, "length_scale": 0.3}],
}  # fmt: skip
"""A horizontal arm that hardly sags, in turbulence of which only the mean counts."""
AREA, EI = np.pi * 0.02**2, 1e6 * np.pi * 0.02**4 / 4


@pytest.fixture(scope="module")
def light() -> xr.Dataset:
    return crinoid.modes(Scenario(**LIGHT), count=4)


def test_an_arm_has_the_modes_of_an_exact_beam_in_air_and_in_still_water(light):
    for medium, density in (("air", 1080), ("still water", 1080 + 1025)):
        natural = NATURAL * np.sqrt(EI / (density * AREA)) / 0.5**2
        ratio = natural * 0.002 / 2
        here = light.sel(medium=medium, mode=[1, 2, 3])
        damped = natural * np.sqrt(1 - ratio**2)
        np.testing.assert_allclose(2 * np.pi * here["frequency"], damped, rtol=1e-3)
        np.testing.assert_allclose(here["damping_ratio"], ratio, rtol=1e-2)
        np.testing.assert_allclose(here["decay_rate"], ratio * natural, rtol=1e-2)
    assert light.attrs["status"] == "ok"
    assert "in still water drag, which is quadratic, damps no small" in light.attrs["notes"]


def test_the_mean_current_damps_a_stiff_arm_by_the_slope_of_its_drag(light):
    here = light.sel(medium="mean current", mode=[1, 2, 3])
    np.testing.assert_allclose(here["current"], [0.0, 0.05])
    still = light.sel(medium="still water", mode=[1, 2, 3])
    slope = 1025 * Scenario().water.drag_normal * 0.04 * 0.05
    added = slope / (2 * (1080 + 1025) * AREA)
    np.testing.assert_allclose(here["decay_rate"] - still["decay_rate"], added, rtol=1e-2)
    # the current bends the arm up: its equilibrium is another
    tip = light["position"].isel(node=-1).sel(axis="z")
    assert float(tip.sel(medium="mean current") - tip.sel(medium="still water")) > 1e-3


def test_in_water_the_arm_sags_only_by_what_buoyancy_leaves_of_its_weight(light):
    tip = light["position"].isel(node=-1).sel(axis="z") + 10.0
    for medium, density in (("air", 1080), ("still water", 1080 - 1025)):
        sag = -density * AREA * 0.001 * 0.5**4 / (8 * EI)
        assert float(tip.sel(medium=medium)) == pytest.approx(sag, rel=1e-3)
    alone = crinoid.modes(Scenario(**LIGHT), count=4, in_air=True)
    in_air = light.sel(medium="air").drop_vars("lock_in_speed")
    xr.testing.assert_allclose(alone.squeeze(), in_air)


@pytest.mark.slow
def test_an_arm_that_finds_no_rest_has_no_modes(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    hasty = Scenario(**LIGHT, simulation={"max_iterations": 1})
    line = "failed in air: no static equilibrium found"
    with pytest.raises(ModesError, match=line):
        crinoid.modes(hasty)
    (tmp_path / "hasty.toml").write_text(hasty.to_toml())
    assert refused("modes", "hasty.toml", code=3).startswith(f"crinoid: {line}")
    assert [path.name for path in tmp_path.iterdir()] == ["hasty.toml"]


@pytest.mark.slow
def test_in_space_the_arm_has_the_same_modes_in_both_directions(light, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    flow = [{"kind": "uniform", "velocity": [0.0, 0.0, 0.05]}]
    space = Scenario(title="mine", **LIGHT | {"flow": flow, "arm": LIGHT["arm"] | {"dimension": 3}})
    (tmp_path / "mine.toml").write_text(space.to_toml())
    written = succeeded("modes", "mine.toml", "--count", "4")
    folder = tmp_path / "results" / "mine-modes"
    assert sorted(path.name for path in folder.iterdir()) == ["modes.nc", "modes.png"]
    assert_shows_something(folder / "modes.png")
    found = xr.load_dataset(folder / "modes.nc")
    for name in found.data_vars:
        assert found[name].attrs["units"]
        assert found[name].attrs["long_name"]
    assert Scenario.from_toml(found.attrs["scenario"]) == space
    assert f"note: {found.attrs['notes']}" in written.splitlines()
    for medium in ("air", "still water"):
        flat = light["frequency"].sel(medium=medium).values[:2]
        both = found["frequency"].sel(medium=medium).values
        np.testing.assert_allclose(both, np.repeat(flat, 2), rtol=1e-4)
    # along the current its drag has twice the slope that it has across
    still = float(light["decay_rate"].sel(medium="still water", mode=1))
    added = float(light["decay_rate"].sel(medium="mean current", mode=1)) - still
    rates = np.sort(found["decay_rate"].sel(medium="mean current").values[:2])
    np.testing.assert_allclose(rates - still, [added / 2, added], rtol=0.01)
    assert [path.name for path in write_report(folder)] == ["modes.png"]


@pytest.mark.slow
def test_speeds_of_lock_in_are_the_frequency_times_diameter_and_reduced_velocity():
    scenario = crinoid.load("wave-zone", ["arm.nodes=6", "water.vortices={}"])
    found = crinoid.modes(scenario, count=3)
    first = float(found["frequency"].sel(medium="still water", mode=1))
    # 1.5 cm of radius; centre +- range of synchronisation
    assert found["lock_in_speed"].sel(mode=1).values == pytest.approx(
        first * 0.03 / np.array([0.26, 0.1])
    )
    assert np.isnan(found["lock_in_speed"].sel(mode=3)).all()


def test_vortices_lock_in_to_bending_and_not_to_stretch(light):
    still = light.sel(medium="still water")
    stretches = float(np.sqrt(1e6 / 1080)) / (4 * 0.5)  # slowest wave along a clamped bar
    undamped = np.hypot(2 * np.pi * still["frequency"], still["decay_rate"]) / (2 * np.pi)
    assert float(undamped.sel(mode=4)) == pytest.approx(stretches, rel=0.02)
    assert np.isfinite(light["lock_in_speed"]).all("end").values.tolist() == [True] * 3 + [False]


def test_vortices_lock_in_to_bending_in_space_and_not_to_twist():
    along, up = np.eye(3)[0] * np.linspace(0, 1, 5)[:, None], np.eye(3)[2] * np.ones((5, 1))
    shape = np.stack([1j * up, along, 0.6 * along + 0.5 * up, 1e-9 * up])
    spin = np.outer([0, 0, 0, 1j], np.ones(4))
    tangent = np.tile([1.0, 0.0, 0.0], (4, 1))
    found = bending(shape, spin, tangent, np.full(5, 0.02))
    assert found.tolist() == [True, False, True, False]


@pytest.mark.slow
def test_a_loss_factor_is_all_of_the_damping_unless_more_is_asked_for():
    loss = {"value": 0.1, "band_hz": [0.1, 20.0]}
    arm = {**LIGHT["arm"], "nodes": 7, "loss_factor": loss}
    arm.pop("damping_time")
    alone = Scenario(arm=arm, water={"gravity": 0.001})
    assert alone.arm.damping_time == 0.0
    assert Scenario(arm={"relaxation": [{"ratio": 0.5, "time": 1.0}]}).arm.damping_time == 0.0
    assert Scenario().arm.damping_time == 0.02
    assert Scenario().with_values({"arm.loss_factor": loss}).arm.damping_time == 0.0
    found = crinoid.modes(alone, count=2, in_air=True).isel(medium=0)
    np.testing.assert_allclose(found["damping_ratio"], 0.05, rtol=0.05)
    more = crinoid.modes(alone.with_values({"arm.damping_time": 0.002}), count=2, in_air=True)
    # branches stiffen the arm, which leaves less of the ratio
    added = (more["damping_ratio"].isel(medium=0) - found["damping_ratio"]) / found["frequency"]
    assert np.all(added > 0.6 * 0.002 * np.pi)
    assert np.all(added < 0.002 * np.pi)
