"""Modes of a scenario's arm in each medium: against exact beams, and `crinoid modes`."""

import numpy as np
import pytest
import xarray as xr

import crinoid
from crinoid.dynamics import ModesError
from crinoid.report import ReportError, write_report
from crinoid.scenario import Scenario
from test_cli import call
from test_damped_modes import NATURAL
from test_report import assert_shows_something

LIGHT = {
    "arm": {"nodes": 21, "length": 0.5, "radius": 0.02, "density": 1080.0, "youngs_modulus": 1e6,
            "damping_time": 0.002},
    "water": {"gravity": 0.001},
    "flow": [{"kind": "turbulence", "mean": [0.0, 0.05], "intensity": 0.2, "length_scale": 0.3}],
}  # fmt: skip
"""A horizontal arm that hardly sags, in turbulence of which only the mean counts."""


@pytest.fixture(scope="module")
def light() -> xr.Dataset:
    return crinoid.modes(Scenario(**LIGHT), count=4)


def test_an_arm_has_the_modes_of_an_exact_beam_in_air_and_in_still_water(light):
    area, EI = np.pi * 0.02**2, 1e6 * np.pi * 0.02**4 / 4
    for medium, mass in (("air", 1080 * area), ("still water", (1080 + 1025) * area)):
        natural = NATURAL * np.sqrt(EI / mass) / 0.5**2
        ratio = natural * 0.002 / 2
        here = light.sel(medium=medium, mode=[1, 2, 3])
        np.testing.assert_allclose(
            2 * np.pi * here["frequency"], natural * np.sqrt(1 - ratio**2), rtol=1e-3
        )
        np.testing.assert_allclose(here["damping_ratio"], ratio, rtol=1e-2)
        np.testing.assert_allclose(here["decay_rate"], ratio * natural, rtol=1e-2)
    assert light.attrs["status"] == "ok"
    assert "in still water drag, which is quadratic, damps no small" in light.attrs["notes"]


def test_the_mean_current_damps_a_stiff_arm_by_the_slope_of_its_drag(light):
    here = light.sel(medium="mean current", mode=[1, 2, 3])
    np.testing.assert_allclose(here["current"], [0.0, 0.05])
    still = light.sel(medium="still water", mode=[1, 2, 3])
    slope = 1025 * Scenario().water.drag_normal * 0.04 * 0.05
    added = slope / (2 * (1080 + 1025) * np.pi * 0.02**2)
    np.testing.assert_allclose(here["decay_rate"] - still["decay_rate"], added, rtol=1e-2)
    # the current bends the arm up: its equilibrium is another
    tip = light["position"].isel(node=-1).sel(axis="z")
    assert float(tip.sel(medium="mean current") - tip.sel(medium="still water")) > 1e-3


def test_in_air_the_arm_sags_under_all_its_weight_and_in_water_under_what_is_left(light):
    tip = light["position"].isel(node=-1).sel(axis="z") + 10.0
    sag = -1080 * np.pi * 0.02**2 * 0.001 * 0.5**4 / (8 * 1e6 * np.pi * 0.02**4 / 4)
    assert float(tip.sel(medium="air")) == pytest.approx(sag, rel=1e-3)
    assert float(tip.sel(medium="still water")) == pytest.approx(sag * 55 / 1080, rel=1e-3)
    alone = crinoid.modes(Scenario(**LIGHT), count=4, in_air=True)
    xr.testing.assert_allclose(alone.squeeze(), light.sel(medium="air"))


def test_an_arm_that_finds_no_rest_is_said(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    hasty = Scenario(**LIGHT, simulation={"max_iterations": 1})
    with pytest.raises(ModesError, match="failed in air: no static equilibrium found"):
        crinoid.modes(hasty)
    (tmp_path / "hasty.toml").write_text(hasty.to_toml())
    ended = call("modes", "hasty.toml")
    assert ended.exit_code == 3
    (line,) = ended.stderr.strip().splitlines()
    assert line.startswith("crinoid: failed in air: no static equilibrium found")
    assert [path.name for path in tmp_path.iterdir()] == ["hasty.toml"]


def test_in_space_the_arm_has_the_same_modes_in_both_directions(light, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    flow = [{"kind": "uniform", "velocity": [0.0, 0.0, 0.05]}]
    space = Scenario(title="mine", **LIGHT | {"flow": flow, "arm": LIGHT["arm"] | {"dimension": 3}})
    (tmp_path / "mine.toml").write_text(space.to_toml())
    ended = call("modes", "mine.toml", "--count", "4")
    assert ended.exit_code == 0, ended.output
    for words in ("mine", "still water", "mean current", "damping", "of x 0.000, y 0.000, z 0.050"):
        assert words in ended.stdout
    folder = tmp_path / "results" / "mine-modes"
    assert sorted(path.name for path in folder.iterdir()) == ["modes.nc", "modes.png"]
    assert_shows_something(folder / "modes.png")
    with xr.open_dataset(folder / "modes.nc") as dataset:
        found = dataset.load()
    for name in found.data_vars:
        assert found[name].attrs["units"]
        assert found[name].attrs["long_name"]
    assert Scenario.from_toml(found.attrs["scenario"]) == space
    assert f"note: {found.attrs['notes']}" in ended.stdout.splitlines()
    for medium in ("air", "still water"):
        flat = light["frequency"].sel(medium=medium).values[:2]
        both = found["frequency"].sel(medium=medium).values
        np.testing.assert_allclose(both, np.repeat(flat, 2), rtol=1e-4)
    # along the current its drag has twice the slope that it has across
    still = float(light["decay_rate"].sel(medium="still water", mode=1))
    added = float(light["decay_rate"].sel(medium="mean current", mode=1)) - still
    rates = np.sort(found["decay_rate"].sel(medium="mean current").values[:2])
    np.testing.assert_allclose(rates - still, [added / 2, added], rtol=0.01)

    (folder / "modes.png").unlink()
    assert call("report", folder).exit_code == 0
    assert (folder / "modes.png").exists()
    (folder / "modes.nc").write_text("mine")
    refused = call("modes", "mine.toml")
    assert refused.exit_code == 2
    assert "modes.nc was not written by crinoid" in refused.stderr
    with pytest.raises(ReportError, match="not a readable netCDF file"):
        write_report(folder / "modes.nc")
    xr.Dataset({"a": ("b", [1.0])}).to_netcdf(folder / "modes.nc")
    with pytest.raises(ReportError, match="not a file of crinoid with modes, it has no frequency"):
        write_report(folder / "modes.nc")


def test_mistakes_are_one_line_and_nothing_is_written(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.toml").write_text("arm.nodes = 6")
    for mistake, named in (
        (("--count", "0"), "--count: got 0, takes 1 to 10"),
        (("--set", "arm.length=-1"), "arm.length"),
        (("--set", "vary.seed=[1, 2]"), "vary: a mode is of one case"),
    ):
        ended = call("modes", "mine.toml", *mistake)
        assert ended.exit_code == 2
        (line,) = ended.stderr.strip().splitlines()
        assert named in line
    assert [path.name for path in tmp_path.iterdir()] == ["mine.toml"]
