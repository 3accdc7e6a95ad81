"""A vessel by its response amplitude operators moves the base with the waves of the scenario."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr

import crinoid
from crinoid.assembly.prepared import Prepared
from crinoid.base import Base
from crinoid.flow import on_currents
from crinoid.foundation.axes import CHANNELS
from crinoid.scenario import Scenario, ScenarioError

NAMES = ("surge", "sway", "heave", "roll", "pitch", "yaw")
FREQUENCY = np.array([0.2, 0.9, 1.5, 4.5])
HEADING = np.arange(0.0, 360.0, 45.0)
CONVENTIONS = {"phase_is": "lag", "direction_is": "to"}
OFFSET = [9.0, -2.0, -6.0]
TIMES = [0.3, 1.7, 12.9]


def away(angle, from_degrees):
    """Return how far directions (rad) are from one, over half a turn."""
    turned = np.mod(angle - np.deg2rad(from_degrees) + np.pi, 2 * np.pi) - np.pi
    return np.abs(turned) / np.pi


def response(frequency, heading):
    """Return complex motions, linear between the rows of the table: m/m, and rad/m, bow up."""
    head, beam = away(heading, 0.0), away(heading, 90.0)
    motions = [
        (0.6 - 0.1 * frequency) * 1j * (1 - 2 * head),
        (0.5 - 0.1 * frequency) * 1j * (1 - 2 * beam),
        (1 - 0.2 * frequency + 0.1j * frequency) * (1 - 0.2 * head),
        (0.02 + 0.05 * frequency) * 1j * (1 - 2 * beam),
        (0.01 + 0.03j * frequency) * (1 - 2 * head),
        (0.004 * frequency - 0.01j) * (1 - 2 * beam),
    ]
    return np.stack(motions, axis=-1)


def table(
    path,
    frequency=FREQUENCY,
    heading=HEADING,
    frequency_unit="rad/s",
    heading_unit="deg",
    shift=0.0,
    down=1,
    turn="deg/m",
    lead=1,
):
    """Write a table of `response`; its headings differ by ``shift`` degrees from those to which."""
    omega, to = (each.ravel() for each in np.meshgrid(frequency, heading))
    rate = {"rad/s": omega, "Hz": omega / (2 * np.pi), "s": 2 * np.pi / omega}[frequency_unit]
    from_bow = to + shift
    columns = {
        f"{'period' if frequency_unit == 's' else 'frequency'} ({frequency_unit})": rate,
        f"heading ({heading_unit})": from_bow if heading_unit == "deg" else np.deg2rad(from_bow),
    }
    for name, motion in zip(NAMES, response(omega, np.deg2rad(to)).T, strict=True):
        turns = NAMES.index(name) > 2
        size = down if name == "pitch" else 1.0
        size *= np.rad2deg(1.0) if turns and turn == "deg/m" else 1.0
        columns[f"{name} ({turn if turns else 'm/m'})"] = size * np.abs(motion)
        columns[f"{name} phase (deg)"] = lead * np.rad2deg(np.angle(motion))
    rows = zip(*columns.values(), strict=True)
    lines = [",".join(columns), *(",".join(map("{:.17g}".format, row)) for row in rows)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return str(path)


@pytest.fixture
def rao(tmp_path):
    return table(tmp_path / "rao.csv")


def riding(file, dimension=3, flow=None, motion=None, **values):
    vessel = {"kind": "rao", "file": file} | CONVENTIONS | (motion or {})
    regular = {"kind": "regular-wave", "height": 1.0, "period": 6.0, "direction_deg": 20.0}
    scenario = Scenario(arm={"nodes": 5, "dimension": dimension})
    given = {"base.motion": [vessel], "flow": [flow or regular] if flow is None else flow}
    return scenario.with_values(given | values)


SEA = [
    {"kind": "uniform", "velocity": [0.4, -0.3, 0.0]},
    {
        "kind": "waves",
        "significant_height": 1.0,
        "peak_period": 7.0,
        "direction_deg": 110.0,
        "spreading": 4.0,
        "components": 9,
        "ramp_time": 5.0,
    },
    {
        "kind": "regular-wave",
        "height": 0.6,
        "period": 9.0,
        "direction_deg": -160.0,
        "phase_deg": 40,
    },
]
ANGLES = {"base.pan_deg": 40.0, "base.tilt_deg": -50.0, "base.roll_deg": 15.0}


def base_of(scenario):
    """Return the base of a scenario, and its flows on their currents."""
    numbers = crinoid.parameters(scenario)
    flows = on_currents(numbers.flow, numbers.water.gravity)
    base = numbers.base
    return Base(base.angles, jnp.asarray(0.1), base.servo, base.motions(flows)), flows


def own_sum(flows, water_depth, current, place, bow, time):
    """Return shifts and turns of the vessel (m, rad) along its axes, summed over all waves."""
    total = np.zeros(6)
    for flow in flows:
        if not hasattr(flow, "phases"):
            continue
        direction = np.asarray(flow.headings)
        number, omega = np.asarray(flow.wave_numbers), np.asarray(flow.frequencies)
        sigma = np.sqrt(9.81 * number * np.tanh(number * water_depth))
        assert sigma + number * (direction @ current) == pytest.approx(omega, rel=1e-9)
        theta = number * (direction @ place) - omega * time + 2 * np.pi * np.asarray(flow.phases)
        heading = np.arctan2(direction[:, 1], direction[:, 0]) - bow
        ramp, waves = float(flow.onset.ramp_time), response(omega, heading)
        on = 0.5 - 0.5 * np.cos(np.pi * min(time / ramp, 1.0)) if ramp else 1.0
        amplitude = np.asarray(flow.amplitudes)[:, None]
        total += on * np.sum(amplitude * (waves * np.exp(1j * theta)[:, None]).real, axis=0)
    return total


def test_in_space_the_base_moves_by_the_sum_over_all_waves(rao):
    motion = {"heading_deg": 30.0, "offset": OFFSET}
    position = {"base.position": [3.0, -5.0, -8.0], "water.depth": 20.0}
    base, flows = base_of(riding(rao, 3, SEA, motion, **position, **ANGLES))
    bow = np.deg2rad(30.0)
    cosine, sine = np.cos(bow), np.sin(bow)
    axes = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    place = np.array([3.0, -5.0]) - (axes @ OFFSET)[:2]
    level = base.frame(jnp.zeros(6))
    pose = jax.jit(lambda time: base.pose(time, base.servo.at_rest())[0])
    turning = jax.jit(lambda rate: jax.jvp(base.frame, (jnp.zeros(6),), (rate,))[1])
    for time in TIMES:
        found = pose(time)
        moved = own_sum(flows, 20.0, np.array([0.4, -0.3]), place, bow, time)
        turn = moved[3:] * [1, -1, 1]
        assert np.asarray(found)[:3] == pytest.approx(
            axes @ (moved[:3] + np.cross(turn, OFFSET)), abs=1e-10
        )
        # the frame turns, to first order, about the same vector
        assert np.asarray(turning(found)) == pytest.approx(np.cross(axes @ turn, level), abs=1e-10)
        assert np.abs(turn).min() > 1e-5


@pytest.mark.parametrize("bow", [0.0, 180.0])
def test_in_the_plane_it_moves_as_in_space(rao, bow):
    flow = [
        {"kind": "uniform", "velocity": [0.3, 0.0]},
        SEA[1] | {"direction_deg": 180.0, "spreading": None},
    ]
    names = ["slide", "heave", "tilt"]
    found = {}
    for axes, offset in ((2, [9.0, -6.0]), (3, [9.0, 0.0, -6.0])):
        if axes == 3:
            flow[0]["velocity"] = [0.3, 0.0, 0.0]
        motion = {"heading_deg": bow, "offset": offset}
        place = {"base.position": [2.0, -8.0] if axes == 2 else [2.0, 0.0, -8.0]}
        base = Prepared(
            riding(rao, axes, flow, motion, **place, **{"base.tilt_deg": -50})
        ).system.base
        pose = base.pose(jnp.asarray(9.1), base.servo.at_rest())[0]
        channels = CHANNELS[axes]
        found[axes] = [float(pose[channels.index(name)]) for name in names]
    assert found[2] == pytest.approx(found[3], abs=1e-12)
    assert np.abs(found[2]).min() > 1e-3


def test_velocity_and_acceleration_are_its_derivatives(rao):
    base, _ = base_of(riding(rao, 3, SEA, {"offset": OFFSET}, **ANGLES))
    pose, step = jax.jit(lambda time: base.pose(time, base.servo.at_rest())), 1e-4
    for time in TIMES:
        before, now, after = (pose(time + h) for h in (-step, 0, step))
        rate, faster = ((after[i] - before[i]) / (2 * step) for i in (0, 1))
        assert np.asarray(now[1]) == pytest.approx(np.asarray(rate), abs=1e-7)
        assert np.asarray(now[2]) == pytest.approx(np.asarray(faster), abs=1e-7)


def test_its_gradient_by_the_amplitudes_is_its_motion_per_amplitude(rao):
    numbers = crinoid.parameters(riding(rao, 3, SEA, {"offset": OFFSET}, **ANGLES))

    def shift(amplitudes):
        flows = tuple(
            each if given is None else replace(each, amplitudes=given)
            for each, given in zip(numbers.flow, amplitudes, strict=True)
        )
        motions = numbers.base.motions(on_currents(flows, numbers.water.gravity))
        return sum(motion.displacement(jnp.asarray(8.0))[2] for motion in motions)

    given = [getattr(each, "amplitudes", None) for each in numbers.flow]
    heave, slopes = jax.value_and_grad(shift)(given)
    # linear in the amplitudes
    total = sum(jnp.sum(a * s) for a, s in zip(given, slopes, strict=True) if a is not None)
    assert float(total) == pytest.approx(float(heave), rel=1e-9)
    assert abs(float(heave)) > 0.01


FORMS = {
    "periods": ({"frequency_unit": "s"}, {}),
    "Hz, rad": ({"frequency_unit": "Hz", "heading_unit": "rad", "turn": "rad/m"}, {}),
    "leads": ({"lead": -1}, {"phase_is": "lead"}),
    "from": ({"shift": 180.0}, {"direction_is": "from"}),
    "bow down": (
        {"down": -1},
        {"columns": {"pitch": "-pitch"}},
    ),
    "half": ({"heading": np.arange(0.0, 181.0, 45.0)}, {"symmetric": True}),
    "other half": ({"heading": np.arange(-180.0, 1.0, 45.0)}, {"symmetric": True}),
    "a whole turn": ({"heading": np.arange(-180.0, 181.0, 45.0)}, {}),
}


@pytest.mark.parametrize("name", FORMS)
def test_each_convention_of_a_table_has_a_key(rao, tmp_path, name):
    form, keys = FORMS[name]
    known = Prepared(riding(rao)).series["base.motion.0"]
    other = table(tmp_path / "other.csv", **form)
    found = Prepared(riding(other, motion=keys)).series["base.motion.0"]
    assert found.frequency == pytest.approx(known.frequency, rel=1e-12)
    assert found.heading == pytest.approx(known.heading, abs=1e-9)
    assert found.values == pytest.approx(known.values, abs=1e-9)
    assert found.values == pytest.approx(
        response(known.frequency[:, None], np.deg2rad(HEADING)), abs=1e-9
    )


def test_columns_name_the_motions_and_leave_some_out(rao, tmp_path):
    text = (tmp_path / "rao.csv").read_text().replace("heave phase", "z_phase")
    (tmp_path / "rao.csv").write_text(text.replace("heave (m/m)", "z (m/m)"))
    keys = {"columns": {"heave": "z", "sway": "0"}}
    values = Prepared(riding(rao, motion=keys)).series["base.motion.0"].values
    known = response(FREQUENCY[:, None], np.deg2rad(HEADING))
    assert values[..., 2] == pytest.approx(known[..., 2], abs=1e-9)
    assert not values[..., 1].any()


def hydrodynamics(path, names):
    """Write a dataset as capytaine does, and return the motions that solve its equation."""
    random = np.random.default_rng(3)
    inertia, stiffness = np.diag([1.0, 1, 1, 6, 9, 9]), np.diag([0.0, 0, 5, 8, 30, 0])
    added, damping = (0.3 * random.random((4, 6, 6)) for _ in range(2))
    parts = random.normal(size=(2, 2, 4, 8, 6))
    order = [2, 0, 1, 3, 4, 5]  # the names of motions count, not their order
    labels = [NAMES[i].capitalize() for i in order]
    omega = FREQUENCY[:, None, None]
    matrix = -(omega**2) * (inertia + added) - 1j * omega * damping + stiffness
    force = parts[0] + 1j * parts[1]  # of Froude-Krylov and of diffraction
    solved = np.linalg.solve(matrix[:, None], force.sum(axis=0)[..., None])[..., 0]

    def split(value, axis):
        return np.stack([value.real, value.imag], axis=axis)

    rows, columns = np.ix_(order, order)
    dofs, waves = ("influenced_dof", "radiating_dof"), ("omega", "wave_direction", "influenced_dof")
    data = {
        "inertia_matrix": (dofs, inertia[rows, columns]),
        "hydrostatic_stiffness": (dofs, stiffness[rows, columns]),
        "added_mass": (("omega", *dofs), added[:, rows, columns]),
        "radiation_damping": (("omega", *dofs), damping[:, rows, columns]),
        "Froude_Krylov_force": (("complex", *waves), split(force[0][..., order], 0)),
        "diffraction_force": (("complex", *waves), split(force[1][..., order], 0)),
        "RAO": (("complex", *waves[:2], dofs[1]), split(solved[..., order], 0)),
    }
    axes = {"omega": FREQUENCY, "wave_direction": np.deg2rad(HEADING), "complex": ["re", "im"]}
    axes |= dict.fromkeys(dofs, labels) | {"forward_speed": 0.0}
    coordinates = {k: (k, v) if np.ndim(v) else v for k, v in axes.items()}
    whole = xr.Dataset({name: data[name] for name in names(data)}, coordinates)
    whole.to_netcdf(path)
    return solved * [1, 1, 1, 1, -1, 1]  # right-handed about y to port lowers the bow


@pytest.mark.parametrize("rao", [True, False])
def test_a_file_of_capytaine_has_raos_or_what_gives_them(tmp_path, rao):
    path = tmp_path / "barge.nc"
    known = hydrodynamics(path, lambda data: ["RAO"] if rao else [n for n in data if n != "RAO"])
    open_ended = dict.fromkeys(CONVENTIONS)
    read = Prepared(riding(str(path), motion=open_ended)).series["base.motion.0"]
    assert read.values == pytest.approx(known, rel=1e-12)
    assert read.heading == pytest.approx(np.deg2rad(HEADING), abs=1e-12)


def test_waves_beyond_the_frequencies_have_a_note_and_few_of_them(tmp_path):
    sea = [{"kind": "waves", "significant_height": 1.0, "peak_period": 7.0, "components": 100}]
    most = table(tmp_path / "most.csv", frequency=np.array([0.2, 2.0]))
    notes = Prepared(riding(most, flow=sea)).notes()
    expected = "of the energy of the waves is outside of 0.2 to 2 rad/s: there the RAOs are"
    assert len(notes) == 1
    assert expected in notes[0]
    assert notes[0].startswith("base.motion.0: flow.0: ")
    some = table(tmp_path / "some.csv", frequency=np.array([0.2, 1.0]))
    with pytest.raises(ScenarioError, match=r"base.motion.0.file: \d+% of the energy.*most 5%"):
        Prepared(riding(some, flow=sea)).notes()


def test_the_base_stays_within_its_travel(rao):
    scenario = riding(rao, flow=SEA, motion={"offset": OFFSET}, **ANGLES)
    base, _ = base_of(scenario)
    shift = jax.jit(jax.vmap(lambda time: base.pose(time, base.servo.at_rest())[0][:3]))
    largest = np.linalg.norm(shift(jnp.linspace(0.0, 600.0, 3000)), axis=1).max()
    travel = Prepared(scenario).facts.travel
    assert 0.15 * travel < largest < travel


def replaced(*changes):
    """Return a change of the text of a table."""

    def change(text):
        for old, new in changes:
            assert old in text
            text = text.replace(old, new, 1)
        return text

    return change


AXIS = "frequency (rad/s)"
MISTAKES = [
    (None, {"phase_is": None}, 'phase_is: missing; must be "lag" or "lead" for a table'),
    (None, {"direction_is": None}, 'direction_is: missing; must be "to" or "from" for a table'),
    (
        replaced((AXIS, "frequency")),
        {},
        "file: frequency names no unit; must be in rad",
    ),
    (
        replaced((AXIS, "frequency (1/s)")),
        {},
        'file: frequency is in "1/s"; must be in',
    ),
    (replaced(("heave (m/m)", "heave (m)")), {}, 'columns.heave: heave is in "m"; must be in m/m'),
    (
        replaced(("roll (deg/m)", "roll (deg)")),
        {},
        'columns.roll: roll is in "deg"; must be in deg/m',
    ),
    (
        replaced(("roll (deg/m)", "roll (rad/rad)")),
        {},
        "columns.roll: roll is in .rad/rad.; must be",
    ),
    (
        replaced(("yaw phase (deg)", "yaw phase")),
        {},
        "columns.yaw: yaw phase names no unit; must be",
    ),
    (replaced(("yaw phase (deg)", "yaw lag (deg)")), {}, 'columns.yaw: got "yaw phase", no such'),
    (
        replaced(("\n0.9", "\n0.8")),
        {},
        "file: rao.csv has a frequency that is not above 0, or lacks a row",
    ),
    (None, {"symmetric": True}, "symmetric: got true for a file with headings of port and starb"),
    (
        None,
        {"columns": dict.fromkeys(NAMES, "0")},
        "columns: every motion is 0; must name a column",
    ),
    (replaced(("frequency (", "omega (")), {}, 'file: got "frequency", no such column in rao.csv'),
    (
        replaced(("\n0.9", "\n0.20000000000000001")),
        {},
        "file: rao.csv has two rows of one frequency",
    ),
]


@pytest.mark.parametrize(("change", "motion", "text"), MISTAKES)
def test_a_table_that_leaves_something_open_is_refused_in_one_line(
    rao, tmp_path, change, motion, text
):
    if change is not None:
        path = tmp_path / "rao.csv"
        path.write_text(change(path.read_text()))
    with pytest.raises(ScenarioError, match=rf"base.motion.0.{text}") as found:
        Prepared(riding(rao, motion=motion)).notes()
    assert len(found.value.lines) == 1


def test_headings_that_the_table_lacks_are_refused(tmp_path):
    half = table(tmp_path / "half.csv", heading=np.arange(0.0, 181.0, 45.0))
    starboard = [SEA[2] | {"direction_deg": -60.0}]
    with pytest.raises(ScenarioError, match=r"waves travel at 300 degrees from .*symmetric = true"):
        crinoid.parameters(riding(half, flow=starboard))
    crinoid.parameters(riding(half, flow=starboard, motion={"symmetric": True}))


def test_a_steep_arm_in_space_needs_a_vessel_that_does_not_roll(rao):
    steep = {"base.tilt_deg": -88.0}
    with pytest.raises(ScenarioError, match=r"columns: the arm has a tilt of -88 degrees while"):
        crinoid.parameters(riding(rao, **steep))
    upright = {"columns": {"roll": "0"}}
    base, _ = base_of(riding(rao, motion=upright, **steep))
    assert np.isfinite(base.pose(jnp.asarray(1.0), base.servo.at_rest())[0]).all()
