"""The judge of a run's energy ledger, on made-up books."""

import re

import numpy as np
import pytest
import xarray as xr

import crinoid
from crinoid.assembly.prepared import Prepared
from crinoid.diagnostics.control_loop import unresolved_vibrations
from crinoid.diagnostics.energy_balance import Defect, find_defect
from crinoid.elements import ENERGIES, WORKS
from helpers.made_results import of_values

NODES = 5
TIME = np.linspace(0.0, 10.0, 101)
FLOOR = 1e-12


def books(defect, *, scale=1.0, residual=0.0, rate=2.0, tip=1e-3) -> xr.Dataset:
    """Make a run whose loads do the work ``scale`` and in which energy is off by ``defect`` (J).

    Its tip swings by ``tip`` (m) at a circular frequency ``rate``.
    """
    energy = np.zeros((TIME.size, len(ENERGIES) + len(WORKS)))
    energy[:, 0] = 3.0 + scale * TIME / TIME[-1] + defect
    energy[:, len(ENERGIES) + WORKS.index("loads")] = scale * TIME / TIME[-1]
    shape = np.linspace(0.0, tip, NODES)[:, None] * [0.0, 1.0]
    place = np.linspace(0.0, 0.5, NODES)[:, None] * [1.0, 0.0]
    swing = np.sin(rate * TIME)[:, None, None]
    moving = np.cos(rate * TIME)[:, None, None]
    return of_values(
        2,
        TIME,
        place[:, 0],
        np.full(NODES, 0.04),
        energy=energy,
        position=place + swing * shape,
        velocity=rate * moving * shape,
        acceleration=-(rate**2) * swing * shape,
        tension=np.ones((TIME.size, NODES - 1)),
        residual=np.full(TIME.size, residual),
    )


def judged(dataset: xr.Dataset, step_energy: float = 0.0, **simulation: object) -> Defect | None:
    keys = {f"simulation.{key}": value for key, value in simulation.items()}
    return find_defect(dataset, crinoid.Scenario().with_values(keys), FLOOR, step_energy)


def ramp(size: float) -> np.ndarray:
    """Return a defect that grows evenly from the middle of the run on."""
    return size * np.maximum(TIME - 5.0, 0.0) / 5.0


def test_books_that_balance_have_no_defect():
    assert judged(books(0 * TIME)) is None
    assert judged(books(ramp(0.015))) is None
    assert judged(books(ramp(-0.015))) is None


def test_a_defect_has_a_size_and_a_time_when_it_began():
    found = judged(books(ramp(-0.1)))
    assert not found.gained
    assert found.failed is None
    assert found.energy == pytest.approx(-0.1)
    assert found.scale == pytest.approx(1.0)
    # 2 % of the works until then
    assert found.since == pytest.approx(5.7, abs=0.15)
    assert "the arm lost 0.1 J that no force accounts for, 10%" in found.note
    assert "simulation.time_step = 0.002" in found.note  # a fifth: 0.1 / 25 is 0.4 %


def test_a_defect_of_more_than_half_is_a_failure_at_that_time():
    found = judged(books(ramp(0.9)))
    assert found.gained
    # the gain is kinetic energy, which with the works' own is the largest
    assert found.scale == pytest.approx(1.9)
    assert found.failed is None
    found = judged(books(ramp(-1.2)))
    assert found.failed == pytest.approx(5.0 + 5.0 * 0.5 / 1.2, abs=0.15)
    assert found.failure.startswith(f"failed at t = {found.failed:g} s: the arm lost 1.2 J")


def test_when_it_began_is_seen_by_what_was_large_before():
    # an arm that blew up: its last energy is a million times what it was
    defect = 0.1 * (TIME > 7.0) + 1e6 * (TIME > 9.95)
    found = judged(books(defect))
    assert found.failed == pytest.approx(10.0)
    assert found.since == pytest.approx(7.1)


def test_what_the_solver_lets_pass_is_no_defect():
    # the nodes of a swing of 0.1 um go 3 to 5 um in all: a force of 1e-3 N does 3e-9 J or more
    defect = 1e-10 * TIME
    assert judged(books(defect, scale=1e-9, residual=1e-3, tip=1e-7)) is None
    assert judged(books(defect, scale=1e-9, residual=1e-4, tip=1e-7)) is not None
    # nor is round-off, of what is stored and of how the arm is pulled
    assert judged(books(1e-16 * TIME, scale=1e-18)) is None


RINGING = 3.0 / 0.01
"""Angular frequency of a vibration that turns by 3 rad in a time step (rad/s)."""


@pytest.mark.parametrize(
    ("options", "rate", "size", "said"),
    [
        ({"tolerance": 1e-3}, 2.0, 0.1, "= 0.001 only. Try simulation.tolerance = 1e-05"),
        ({}, 2.0, 0.1, "steps of 0.01 s are too long for this motion. Try simulation.time_step ="),
        ({}, RINGING, 0.1, "near 0.021 s are too fast .* or simulation.integrator = .generalized-"),
        ({"integrator": "generalized-alpha"}, RINGING, 0.1, "too fast for .* = [0-9.]+$"),
        ({"integrator": "generalized-alpha"}, RINGING, -0.1, "generalized-alpha damps vibrations"),
        ({"integrator": "implicit-euler"}, 2.0, -0.1, "damps all motion. .*newmark"),
        ({"integrator": "implicit-euler"}, 2.0, 0.1, "too long .*simulation.time_step = 0.002.$"),
        ({"gamma": 0.6, "beta": 0.31}, 2.0, -0.1, r"gamma = 0.6 adds damping. .*gamma = 0.5"),
    ],
)
def test_the_cause_is_sought_in_the_integrator_and_in_vibrations(options, rate, size, said):
    residual = 10.0 if "tolerance" in options else 0.0
    found = judged(books(ramp(size), rate=rate, residual=residual), **options)
    assert re.search(said, found.note)


@pytest.fixture(scope="module")
def rigid() -> dict[str, xr.Dataset]:
    """Run an arm far stiffer than its time steps, in water that swings along it."""
    arm = {"length": 0.4, "nodes": 6, "damping_time": 0.0, "section": {"EI": 1e5, "EA": 1e8}}
    flow = {"kind": "sine", "amplitude": [0.08, 0.0], "frequency_hz": 1.3}
    simulation = {"duration": 2.0, "time_step": 0.005}
    scenario = crinoid.Scenario(arm=arm, flow=[flow], simulation=simulation)
    methods = ("newmark", "generalized-alpha")
    cases = (scenario.with_values({"simulation.integrator": method}) for method in methods)
    return {m: crinoid.simulate(each).dataset for m, each in zip(methods, cases, strict=True)}


def off(run: xr.Dataset) -> float:
    """Return by how much the force on the base is off that of an arm that does not move."""
    late = run.isel(time=run["time"].values > 1.0)
    rate, water = 2 * np.pi * 1.3, crinoid.Scenario().water
    turn, area = rate * late["time"].values, np.pi * 0.02**2
    speed = 0.08 * np.sin(turn)
    # the Froude-Krylov force, and drag along the arm
    force = water.density * area * 0.4 * 0.08 * rate * np.cos(turn)
    drag = 0.5 * water.density * water.drag_tangential * np.pi * 0.04 * 0.4
    force += drag * np.abs(speed) * speed
    left = late["base_force"].values[:, 0] - force
    return float(np.sqrt(np.mean(left**2) / np.mean(force**2)))


@pytest.mark.slow
def test_an_arm_stiffer_than_the_steps_is_judged_by_what_a_step_resolves(rigid):
    run = rigid["generalized-alpha"]
    assert off(run) < 0.02
    assert run.attrs["status"] == "ok"
    assert "ledger" not in run.attrs["notes"]
    assert "do not resolve" not in run.attrs["notes"]


@pytest.mark.release
def test_vibrations_that_steps_do_not_resolve_are_noted_with_the_remedy(rigid):
    run = rigid["newmark"]
    assert off(run) > 0.3
    (note,) = [each for each in run.attrs["notes"].splitlines() if "do not resolve" in each]
    assert note.startswith("vibrations that time steps of 0.005 s do not resolve make up ")
    assert 'simulation.time_step = 0.0005, or simulation.integrator = "generalized' in note


@pytest.mark.parametrize("integrator", ["newmark", "generalized-alpha", "implicit-euler"])
def test_no_remedy_is_the_integrator_that_is_used(integrator):
    arm, simulation = {"nodes": 5}, {"integrator": integrator, "time_step": 0.01}
    scenario = crinoid.Scenario(arm=arm, simulation=simulation)
    system = Prepared(scenario).system
    # all of the arm is thrown to and fro in each step, by the base
    back = 3.0 * (-1.0) ** np.arange(12)
    acceleration = np.zeros((12, 5, 2))
    acceleration[:, 1:, 1] = back[:, None]
    mean = acceleration[:, :, 1] @ [0.125, 0.25, 0.25, 0.25, 0.125]
    force = np.stack([0 * back, -float(system.forces.mass) * mean], axis=1)
    run = xr.Dataset(
        {
            "acceleration": (("time", "node", "axis"), acceleration),
            "base_force": (("time", "axis"), force),
            "step_error": ("time", np.full(12, 1.0)),
        },
        {"arc_length": ("node", np.linspace(0.0, 0.5, 5)), "time": 0.01 * np.arange(12)},
    )
    _, note = unresolved_vibrations(run, system, np.zeros(12), scenario.simulation.or_damping)
    assert note.startswith("vibrations that time steps of 0.01 s do not resolve make up 100%")
    assert f'"{integrator}"' not in note
    assert ("integrator" in note) == (integrator == "newmark")
    still = run * 1e-9  # as that of an arm at rest
    assert unresolved_vibrations(still, system, np.zeros(12), "")[1] == ""


def test_what_a_step_does_not_resolve_is_no_defect():
    assert judged(books(ramp(0.1))) is not None
    assert judged(books(ramp(0.1)), step_energy=6.0) is None
    found = judged(books(ramp(-0.9)), step_energy=2.0)  # which is less than half of it
    assert (found.failed, found.scale) == (None, 2.0)


@pytest.mark.slow
@pytest.mark.parametrize("most", [4, 25, 60])
def test_a_light_stiff_rod_that_rings_is_solved_and_noted_however_many_iterations_it_has(most):
    # the trapezoid rule, undamped: its stretch is a million times faster than a step. A step moves
    # the tip by 17 m and back, so its balance is known less well than positions within its length
    light = {"EA": 1e6, "EI": 1e-2, "mass_per_length": 1e-4}
    scenario = crinoid.Scenario(
        arm={"length": 0.5, "nodes": 11, "section": light},
        water={"density": 0.0, "gravity": 0.0},
        load=[{"kind": "tip", "force": [1.0, 0.0]}],
        simulation={"duration": 0.5, "time_step": 0.01, "start": "rest", "max_iterations": most},
    )
    run = crinoid.simulate(scenario).dataset
    assert run.attrs["status"] == "ok"
    assert int(run["newton_iterations"].max()) < 4 * int(run["steps"].max())
    assert "vibrations that time steps of 0.01 s do not resolve make up" in run.attrs["notes"]
