"""Chambers and tendons: against what a free arm does by theory, and against differences."""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import eigh

import crinoid
from crinoid.actuation import Follower
from crinoid.assembly.prepared import Prepared
from crinoid.dynamics import ActingForces, Context, System
from crinoid.dynamics.modes import find_modes
from crinoid.dynamics.rows import BOUNDARY_NODES
from crinoid.dynamics.statics import static_stage
from crinoid.elements import WORKS, Motion, Threads
from crinoid.numerics.frames import Frames
from crinoid.simulation import play
from crinoid.simulation.frequency_response import Plant
from helpers.arms import QUICKLY, dense, order
from helpers.motion import march_with_books
from helpers.newton_steps import assert_converges_quadratically, slopes, solve_afloat
from validation.elastica import elastica

RADIUS, LENGTH, MODULUS = 0.02, 0.5, 1e5
EI, EA = MODULUS * np.pi / 4 * RADIUS**4, MODULUS * np.pi * RADIUS**2
GJ = EI / 1.5
PRESSURE, AREA, OFFSET = 3e4, 2e-4, 0.008
STILL = {"density": 0.0, "gravity": 0.0}
BENT = PRESSURE * AREA * OFFSET / EI
"""Curvature at full pressure, away from the chamber (rad/m)."""


def held(share):
    """Return a schedule that stays at a share."""
    return {"time": [0.0, 1.0], "share": [share, share]}


FULL = held(1.0)


def chamber(**changes):
    usual = {"offset": OFFSET, "area": AREA, "max_pressure": PRESSURE, "schedule": FULL}
    return usual | changes


def scenario(axes=2, nodes=11, section=None, **tables):
    arm = {"dimension": axes, "nodes": nodes, "length": LENGTH, "damping_time": 0.1}
    if section is not None:
        arm["section"] = section
    return crinoid.Scenario.from_dict({"arm": arm, "water": STILL} | tables)


_energy = eqx.filter_jit(System.energy)


@eqx.filter_jit
def _settled(system):
    state, outcome = system.find_equilibrium()
    return state, system.strains(state), outcome.converged


def settled(described):
    state, strains, converged = _settled(crinoid.system(described))
    assert converged
    return state, np.asarray(strains)


def stretched(position):
    """Return the lengths of edges over those at rest, which are all the same."""
    edges = np.linalg.norm(np.diff(np.asarray(position), axis=0), axis=1)
    return edges * edges.size / LENGTH


# --- statics --------------------------------------------------------------------------------------


def test_uniform_pressure_bends_a_straight_arm_to_a_circle_and_stretches_it():
    state, strains = settled(scenario(chamber=[chamber()]))
    np.testing.assert_allclose(strains[:, 0], -BENT, rtol=1e-6)
    np.testing.assert_allclose(stretched(state.position[1:]), 1 + PRESSURE * AREA / EA, rtol=1e-6)


THIRDS, WINDING, SMALL = (0.0, 120.0, 240.0), 0.005, 1e-3
"""Angles of chambers (degrees), offset of tendons that wind (m), and their tension (N)."""


def crowded(shares, wound, pump, winch):
    """Settle an arm with threads of all kinds, which one program does for each of their numbers.

    ``shares`` are those of three chambers. A pair of tendons that wind is ``wound`` by a share.
    ``pump`` and ``winch`` change threads of given length and volume.
    """
    chambers = [
        chamber(angle_deg=angle, schedule=held(share)) | part
        for angle, (share, part) in zip(THIRDS, shares, strict=True)
    ]
    helical = {"offset": WINDING, "twist_deg": 90.0, "max_tension": SMALL, "schedule": held(wound)}
    tendons = [helical | {"angle_deg": angle} for angle in (0.0, 180.0)]
    tendons.append(WINCH | {"pair": True} | winch)
    return settled(scenario(3, nodes=21, chamber=[*chambers, PUMP | pump], tendon=tendons))


def without_lines(shares, wound):
    """Settle that arm with a slack winch and a pump that does not resist."""
    slack = {"schedule": held(0.0)}
    each = [(float(share), {}) for share in shares]
    return crowded(each, wound, slack | {"bulk_modulus": 1e-9}, slack | {"stiffness": 1e-9})


@pytest.mark.slow
def test_three_chambers_bend_away_from_where_they_push():
    at_random = np.random.default_rng(0).uniform(size=(3, 3))
    for shares in ((1.0, 0.0, 0.0), (0.7, 0.7, 0.0), *at_random):
        _, strains = without_lines(shares, 0.0)
        bent = -BENT * np.array([np.cos(np.deg2rad(THIRDS)), np.sin(np.deg2rad(THIRDS))]) @ shares
        np.testing.assert_allclose(strains, np.broadcast_to([*bent, 0.0], (21, 3)), atol=2e-6)


@pytest.mark.slow
def test_a_helical_tendon_twists_and_shortens():
    # small: T r^2 w / (L GJ) of twist for w rad over L, and T / EA of strain, on a straight axis
    tension, wound, radius = SMALL, np.deg2rad(90.0), WINDING
    state, strains = without_lines((0.0, 0.0, 0.0), 1.0)
    slope = wound / LENGTH  # of the winding, rad/m
    pitch = np.sqrt(1 + (radius * slope) ** 2)
    expected = -2 * tension * radius**2 * slope / (pitch * GJ)
    np.testing.assert_allclose(strains[2:-2, 2], expected, rtol=2e-3)
    shortened = 1 - float(state.position[-1, 0]) / LENGTH
    np.testing.assert_allclose(shortened, 2 * tension / (pitch * EA), rtol=2e-2)


def test_routed_and_given_as_curvature_agree_to_second_order():
    for share in (0.4, 0.2, 0.1):
        schedule = {"schedule": held(share)}
        bent = {"max_curvature": BENT, "max_pressure": PRESSURE} | schedule
        _, routed = settled(scenario(chamber=[chamber(**schedule)]))
        state, plain = settled(scenario(chamber=[bent]))
        np.testing.assert_allclose(plain[:, 0], -share * BENT, rtol=1e-6)
        np.testing.assert_allclose(stretched(state.position[1:]), 1.0, rtol=1e-6)
        # in these strains the bend is the same; what differs is the stretch
        assert np.abs(routed - plain).max() < 1e-6 * BENT


def test_a_taper_bends_by_the_offset_where_it_is():
    _, strains = settled(scenario(chamber=[chamber(offset=[0.01, 0.002])]))
    offset = 0.01 - 0.008 * np.linspace(0.0, 1.0, 11)[:-1]
    slant = np.cos(np.arctan(0.008 / LENGTH))  # of the route: what is left of the push along it
    np.testing.assert_allclose(strains[:-1, 0], -BENT * offset / OFFSET * slant, rtol=3e-5)


@pytest.mark.release
def test_pressure_stiffens_a_beam_under_a_load_at_its_tip():
    # on the axis it bends nothing by itself, nor does a load far below the push stretch anything
    force, added, on_axis = 1e-5, 0.6, {"offset": 0.0, "area": 1e-9}
    tip = {"kind": "tip", "force": [0.0, force]}
    deflections = []
    for stiffening in (0.0, added):
        pushes = chamber(stiffening=stiffening, **on_axis)
        state, _ = settled(scenario(chamber=[pushes], load=[tip]))
        deflections.append(float(state.position[-1, 1]))
    h = 0.1  # of an edge over the length: half of it is at the root, none at the tip
    assert deflections[0] == pytest.approx(force * LENGTH**3 / (3 * EI), rel=h**2)
    assert deflections[0] / deflections[1] == pytest.approx(1 + added, rel=1e-5)


@pytest.mark.slow
def test_pressure_and_a_load_at_the_tip_bend_the_elastica():
    """A thread at a constant offset is the moment p A e all along the arm.

    Its follower force at the tip, and the contact along its route, together do nothing else to an
    arm that does not stretch: the elastica with a moment and a dead load at its tip.
    """
    force = 0.4
    exact = elastica((-1.5, 1.5), dead=(0.0, force * LENGTH**2 / EI), moment=-BENT * LENGTH)
    tip, errors = {"kind": "tip", "force": [0.0, force]}, []
    for nodes in (21, 41):
        state, _ = settled(scenario(2, nodes, {"EA": 1e5}, chamber=[chamber()], load=[tip]))
        errors.append(np.linalg.norm(np.asarray(state.position[-1]) / LENGTH - [exact.x, exact.z]))
    assert abs(exact.z) > 0.1
    assert errors[1] < 1e-3, errors
    assert order(errors) == pytest.approx(2.0, abs=0.2)


def test_half_a_span_bends_half_of_the_arm():
    _, strains = settled(scenario(chamber=[chamber(span=[0.5, 1.0])]))
    expected = -BENT * np.array([0.0] * 5 + [0.5] + [1.0] * 5)
    np.testing.assert_allclose(strains[:, 0], expected, atol=1e-6)


def test_a_pair_pushes_on_either_side():
    _, up = settled(scenario(chamber=[chamber(pair=True, schedule=held(-0.5))]))
    _, down = settled(scenario(chamber=[chamber(angle_deg=180.0, max_pressure=PRESSURE / 2)]))
    np.testing.assert_allclose(up, down, atol=1e-9)
    assert up[3, 0] > 0


# --- threads of given length and volume -----------------------------------------------------------

WINCH = {"drive": "length", "offset": OFFSET, "max_shortening": 0.02, "stiffness": 2e3}
PUMP = {"drive": "volume", "offset": OFFSET, "area": AREA, "max_volume": 2e-6, "bulk_modulus": 1e5}
TOE = 1e-4  # over which a tendon grows taut


def yields(offset, nodes=11):
    """Return by how much of its path an arm yields to a force along it (m/N).

    The last half edge does not bend.
    """
    return LENGTH / EA + offset**2 / EI * LENGTH * (1 - 0.5 / (nodes - 1))


@pytest.fixture(scope="module")
def wound():
    """Return a function of a winch's share, its tendon's offset, and what both lines resist."""
    parameters = crinoid.parameters(
        scenario(chamber=[PUMP | {"schedule": FULL}], tendon=[WINCH | {"schedule": FULL}])
    )

    @eqx.filter_jit
    def of(share, offset, stiffness, modulus):
        def settle(share):
            threads = eqx.tree_at(
                lambda t: (t.shares, t.offset, t.stiffness),
                parameters.actuator[0],
                (
                    jnp.stack([jnp.ones(2), jnp.full(2, share)]),
                    jnp.stack([jnp.full(2, OFFSET), jnp.full(2, offset)]),
                    jnp.stack([modulus, stiffness]),
                ),
            )
            system = crinoid.assemble(eqx.tree_at(lambda p: p.actuator, parameters, (threads,)))
            state, outcome = system.find_equilibrium()
            strains, at = system.strains(state)[:, 0], state.position[1:]
            return (strains, at, state.motion.line), outcome.converged

        values, linear, converged = jax.linearize(settle, share, has_aux=True)
        slopes = linear(jnp.ones(()))
        return values, slopes, jax.linear_transpose(linear, share)(slopes)[0], converged

    def found(*numbers):
        values, slopes, back, converged = of(*map(jnp.asarray, numbers))
        assert converged
        # backward, weighted by the slopes themselves
        squares = sum(float(np.sum(each**2)) for each in jax.tree.leaves(slopes))
        assert float(back) == pytest.approx(squares, rel=1e-9)
        return values, slopes

    return found


@pytest.mark.slow
@pytest.mark.parametrize(("share", "offset"), [(1.0, OFFSET), (0.5, -OFFSET), (0.7, 0.0)])
def test_a_tendon_of_given_length_bends_and_shortens_the_arm_to_it(wound, share, offset):
    stiffness, free = WINCH["stiffness"], LENGTH - share * WINCH["max_shortening"]
    (strains, position, (_, tension)), slope = wound(share, offset, stiffness, 0.0)
    # EA (path / free - 1 - toe / 2) of a path that is shorter by what the arm yields
    compliance = 1 / stiffness + yields(offset) / free
    expected = (LENGTH / free - 1 - TOE / 2) / compliance
    np.testing.assert_allclose(tension, expected, rtol=1e-8)
    np.testing.assert_allclose(strains, expected * offset / EI, atol=1e-8)
    np.testing.assert_allclose(stretched(position), 1 - expected / EA, rtol=1e-9)
    # and its slope, of the solution: the free length changes by -max_shortening
    grown = (LENGTH - expected * yields(offset)) / free**2 * WINCH["max_shortening"] / compliance
    np.testing.assert_allclose(slope[2][1], grown, rtol=1e-6)
    np.testing.assert_allclose(slope[0], grown * offset / EI, atol=1e-6)


def test_a_slack_tendon_leaves_the_arm_alone(wound):
    (strains, _, loads), _ = wound(0.0, OFFSET, WINCH["stiffness"], 0.0)
    # of a strain within round-off, as the toe has it
    assert np.abs(loads).max() < 1e-20
    np.testing.assert_allclose(strains, 0.0, atol=1e-9)


@pytest.mark.slow
def test_the_plane_and_space_agree():
    part = {"span": [0.2, 0.7], "offset": [0.01, 0.004]}
    tendon = WINCH | part | {"schedule": held(0.4), "pair": True}
    down = {"angle_deg": 180.0, "schedule": FULL}
    chambers = [chamber(**part), PUMP | down]
    planar, _ = settled(scenario(2, nodes=21, chamber=chambers, tendon=[tendon]))
    # in space the plane of the arm is at 90 degrees; of the other threads none pushes
    up, none = {"angle_deg": 90.0}, (0.0, {})
    spatial, _ = crowded(
        [(1.0, part | up), none, none], 0.0, down | {"angle_deg": 270.0}, tendon | up
    )
    found = [(np.asarray(s.position), np.asarray(s.motion.line)) for s in (planar, spatial)]
    (planar, expected), (spatial, loads) = found
    np.testing.assert_allclose(spatial[:, [0, 2]], planar, atol=1e-9)
    np.testing.assert_allclose(spatial[:, 1], 0.0, atol=1e-9)
    np.testing.assert_allclose(loads, expected, rtol=1e-6, atol=1e-9)
    assert (expected[:2] > 0).all()
    assert expected[2] == 0


def test_a_closed_chamber_keeps_what_is_in_it(wound):
    # p V of a gas, whose absolute pressure is the bulk modulus, in a free arm
    modulus = PUMP["bulk_modulus"]
    (strains, _, (pressure, _)), _ = wound(0.0, OFFSET, 0.0, modulus)
    volume = AREA * (LENGTH + pressure * AREA * yields(OFFSET))
    expected = modulus * (AREA * LENGTH + PUMP["max_volume"])
    assert (pressure + modulus) * volume == pytest.approx(expected, rel=1e-9)
    np.testing.assert_allclose(strains, -pressure * AREA * OFFSET / EI, rtol=1e-6)


@pytest.mark.release
def test_lines_resist_small_motions():
    half = {"schedule": held(0.5)}
    pump, tendon = PUMP | {"bulk_modulus": 1e7} | half, WINCH | {"pair": True} | half
    system = crinoid.system(scenario(nodes=6, chamber=[pump], tendon=[tendon]))

    @eqx.filter_jit
    def about(system):
        def tip(shares):
            values = jnp.broadcast_to(shares[:, None], (2, 2))
            moved = eqx.tree_at(lambda s: s.actuators[0].values, system, values)
            state, outcome = moved.find_equilibrium()
            return system.tip(state), (state, outcome.converged)

        slope, (state, converged) = jax.jacfwd(tip, has_aux=True)(jnp.full(2, 0.5))
        influence, bands = system.influence(state), system.linearise(state)
        return converged, influence, bands, influence.static(bands[0]), slope

    converged, influence, (stiffness, mass), static, slope = about(system)
    assert converged
    np.testing.assert_allclose(static[:, -2:], slope, rtol=1e-6, atol=1e-9)
    none = np.zeros_like(stiffness)
    (slow,) = Plant(*map(np.asarray, (stiffness, none, mass)), influence).response(np.array([1e-5]))
    np.testing.assert_allclose(slow, static, rtol=1e-6, atol=1e-7)
    free = slice(2 * BOUNDARY_NODES, None)
    K, M = (dense(bands).reshape(14, 14)[free, free] for bands in (stiffness, mass))
    pull, follow = (np.asarray(each) for each in influence.lines)
    added = pull.reshape(14, -1)[free] @ follow.reshape(-1, 14)[:, free]
    np.testing.assert_allclose(added, added.T, rtol=1e-9, atol=1e-9 * np.abs(added).max())
    expected = np.sqrt(eigh(K + added, M, eigvals_only=True)) / (2 * np.pi)
    found = find_modes(stiffness, mass, 4, influence.lines).frequency
    np.testing.assert_allclose(found, expected[:4], rtol=1e-6)
    assert expected[0] > 1.1 * np.sqrt(eigh(K, M, eigvals_only=True)[0]) / (2 * np.pi)


@pytest.mark.release
def test_a_submarine_is_moved_by_the_lines_of_its_arm():
    afloat = {"mass": 5.0, "inertia": 0.3, "offset": [-0.3, 0.0]}
    system = crinoid.system(scenario(nodes=4, tendon=[WINCH | {"schedule": FULL}], vehicle=afloat))
    rng = np.random.default_rng(0)
    noise, rhs = 1e-3 * rng.normal(size=(3, 7, 2)), rng.normal(size=(7, 2))
    given = map(jnp.asarray, ([0.1], noise, rhs))
    solved, _, product, held = solve_afloat(system, *given)
    unknown = np.asarray(solved) != 0
    assert unknown.sum() == 6 + 3
    np.testing.assert_allclose(product[unknown], rhs[unknown], rtol=1e-7)
    np.testing.assert_allclose(held, product[:BOUNDARY_NODES], rtol=1e-7)


# --- the force is the slope of the work -----------------------------------------------------------


def path_work(threads, strains, lengths, drive):
    """Return the sum of tension times path over all windows, as it is defined."""
    tension = threads.pull @ np.maximum(drive, 0) + threads.push_back @ np.maximum(-drive, 0)
    offset, change = np.asarray(threads.offset), np.asarray(threads.change)
    total = 0.0
    for window in range(tension.shape[0]):
        before, behind = lengths[window], lengths[window + 1]
        share = threads.share[window]
        for lane in range(tension.shape[1]):
            d, dd = offset[window, lane], change[window, lane]
            along = share[0] * before + share[1] * behind - d @ strains[window, : d.size]
            twist = strains[window, 2] if strains.shape[1] == 3 else 0.0
            aside = dd + (twist * np.array([-d[1], d[0]]) if d.size == 2 else 0.0)
            total += tension[window, lane] * np.sqrt(along**2 + np.sum(aside**2))
    return total


def lanes(axes):
    """Return two tables of tendons, the first a pair that winds about a spatial arm."""
    wound = {"twist_deg": 120.0, "angle_deg": 30.0} if axes == 3 else {}
    first = {"offset": [0.01, 0.004], "max_tension": 2.0, "pair": True, "span": [0.1, 0.9]}
    return first | wound, {"offset": 0.006, "angle_deg": 180.0, "max_tension": 1.0}


def shaken(state, seed):
    """Return positions off those of a state."""
    rows = state.motion.position
    return rows + 0.01 * np.random.default_rng(seed).standard_normal(rows.shape)


@pytest.mark.slow
def test_the_force_is_the_slope_of_tension_times_path():
    # in the plane it is the same: see above
    axes = 3
    system = crinoid.system(scenario(axes, nodes=6, tendon=lanes(axes)))
    (element,) = (e for e in system.forces.elements if isinstance(e, Threads))
    rest = system.rest()
    moved = shaken(rest, 0)
    still = jnp.zeros(moved.shape)
    drive = jnp.array([-0.6, 0.8])
    forces = system.forces
    lone = ActingForces.of(replace(forces, elements=(element,)), Context(drive))
    frames = Frames.of(moved, rest.frames.at(moved))  # carried along to where the shape is

    @eqx.filter_jit(compiler_options=QUICKLY)
    def observed(position):
        water = still[:, :axes]
        oriented = frames.at(position)
        motion = Motion(position, still, still, water, water, jnp.zeros(()), oriented, drive)
        rest_strain = forces.bend.rest_strain
        strains = forces.strains(motion) + rest_strain.reshape(rest_strain.shape[0], -1)
        lengths = jnp.sqrt(jnp.sum(jnp.diff(position[:, :axes], axis=0) ** 2, axis=1))
        return strains, lengths, lone.residual(motion)[0]

    _, _, residual = observed(moved)
    for row, column in [(1, 0), (2, 1), (3, 0), (5, 1), (3, 2), (2, 3), (4, 3)]:
        ends = []
        for sign in (1, -1):
            strains, lengths, _ = observed(moved.at[row, column].add(sign * 1e-6))
            ends.append(path_work(element, *map(np.asarray, (strains, lengths, drive))))
        slope = float(ends[0] - ends[1]) / 2e-6
        assert float(residual[row, column]) == pytest.approx(slope, abs=2e-7), (row, column)


@pytest.fixture(scope="module", params=[2, 3], ids=["plane", "space"])
def tugged(request):
    """Return forces with threads of all kinds, and a stage of a step off the shape at rest."""
    axes = request.param
    first, second = lanes(axes)
    lines = WINCH | {"stiffness": 50.0, "max_shortening": 0.05}
    wound = {key: first[key] for key in ("twist_deg", "angle_deg") if key in first}
    tendons = [first, second, lines | wound, lines | {"angle_deg": 180.0}]
    stiffer = {"max_curvature": 2.0, "span": [0.3, 1.0], "stiffening": 0.5}
    chambers = [stiffer, PUMP | {"bulk_modulus": 1e4}]
    system = crinoid.system(scenario(axes, nodes=6, tendon=tendons, chamber=chambers))
    state = system.rest()
    stage = static_stage(jnp.zeros(()), shaken(state, 1), state.frames, 1e3)
    return system.forces, Context(jnp.array([0.5, 0.7, -0.6, 0.8, 0.9, 1.0])), stage


@pytest.mark.release
def test_the_tangent_is_the_slope_of_the_force(tugged):
    forces, context, stage = tugged
    # of the threads alone, which compiles faster
    (element,) = (e for e in forces.elements if isinstance(e, Threads))
    lone = ActingForces.of(replace(forces, elements=(element,)), context)
    bands, (pull, follow), slope = slopes(lone, stage)
    assert np.abs(follow).max(axis=(1, 2)).all()
    got = dense(bands) + np.einsum("nbl,lmc->nbmc", pull, follow)
    largest = np.abs(slope).max(axis=(2, 3), keepdims=True) + np.finfo(float).tiny
    np.testing.assert_allclose(got / largest, slope / largest, rtol=0, atol=1e-12)


@pytest.mark.release
@pytest.mark.parametrize("tugged", [3], ids=["space"], indirect=True)
def test_newton_converges_quadratically(tugged):
    forces, context, stage = tugged
    forces = ActingForces.of(forces, context)
    off = np.zeros(stage.position.shape)
    off[BOUNDARY_NODES:] = 0.002 * np.random.default_rng(4).uniform(
        -1, 1, off[BOUNDARY_NODES:].shape
    )
    assert_converges_quadratically(forces, stage, off, least=1e-11)


# --- dynamics -------------------------------------------------------------------------------------


def march(system, parts=1):
    """Return the state and the books after 40 steps of 0.02 s, or after as many parts of each."""
    still = jnp.zeros(len(system.inputs))
    state, books, converged = march_with_books(system, still, 0.02 / parts, 40 * parts)
    assert converged
    return state, books


@pytest.mark.slow
def test_the_work_of_pressure_and_tension_closes_the_ledger():
    ramp = {"time": [0.0, 0.4], "share": [0.0, 1.0]}
    tendon = {"offset": [0.01, 0.005], "max_tension": 1.0, "schedule": ramp, "angle_deg": 180.0}
    lines = WINCH | {"pair": True, "schedule": ramp}, PUMP | {"schedule": ramp}
    pushes = chamber(schedule=ramp, time_constant=0.1, stiffening=0.7)
    described = scenario(nodes=6, chamber=[pushes, lines[1]], tendon=[tendon, lines[0]])
    system = crinoid.system(described)
    defects = []
    for parts in (1, 2, 4):
        end, books = march(system, parts)
        defects.append(abs(float(_energy(system, end).sum() - books.work.sum())))
    actuation = float(books.work[WORKS.index("actuation")])
    assert actuation > 0
    assert defects[0] < 0.01 * actuation
    assert (order(defects) > 1.8).all()
    # an arm that does not yield: pressure and tension rise, and do no work
    blocked = crinoid.system(described.with_values({"arm.youngs_modulus": 1e7 * MODULUS}))
    after, books = march(blocked)
    assert float(after.actuators[0].drive[0]) > 0.9
    assert abs(float(books.work[WORKS.index("actuation")])) < 1e-4 * actuation


@pytest.mark.slow
def test_gradients_by_pressure_area_and_offset():
    half = held(0.5)  # none is at a limit
    tendon = WINCH | {"schedule": half, "angle_deg": 180.0}
    parameters = crinoid.parameters(
        scenario(nodes=5, chamber=[chamber(schedule=half)], tendon=[tendon])
    )

    def height(change):
        def numbers(t):
            return (
                t.max_pressure,
                t.area,
                t.offset,
                t.shares,
                t.max_volume,
                t.max_shortening,
                t.stiffness,
            )

        threads = parameters.actuator[0]
        changed = [
            number * (1 + part) for number, part in zip(numbers(threads), change, strict=True)
        ]
        threads = eqx.tree_at(numbers, threads, changed)
        system = crinoid.assemble(eqx.tree_at(lambda p: p.actuator, parameters, (threads,)))
        command = jnp.zeros(len(system.inputs))
        state = jax.lax.fori_loop(0, 4, lambda _, s: system.step(s, command)[0], system.rest())
        return jnp.append(state.position[-1], state.base_moment)

    # at the middle and at both ends, each along its way
    ways = jnp.tile(jnp.eye(7), (3, 1))
    points = 1e-4 * jnp.repeat(jnp.array([0.0, 1.0, -1.0]), 7)[:, None] * ways

    @eqx.filter_jit
    def along(point, way):
        value, linear = jax.linearize(height, point)
        return value, linear(way), jax.linear_transpose(linear, point)(jnp.ones(3))[0]

    found, slopes, back = (np.stack(each) for each in zip(*map(along, points, ways), strict=True))
    differences = (found[7:14] - found[14:]) / 2e-4
    np.testing.assert_allclose(slopes[:7], differences, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(slopes[:7].sum(axis=1), back[0], rtol=1e-9, atol=1e-12)


# --- the actuator ---------------------------------------------------------------------------------


def follower(**changes):
    usual = {"lower": 0.0, "upper": 1.0, "lag": 0.2, "max_rate": 1e12, "dead_band": 0.0}
    return Follower(
        names=("one",),
        kinds=("pressure",),
        times=jnp.array([[0.0, 1.0]]),
        values=jnp.zeros((1, 2)),
        **{name: jnp.array([value]) for name, value in (usual | changes).items()},
    )


_advance = eqx.filter_jit(Follower.advance)


def followed(actuator, commands, step):
    state, drives = actuator.at_rest(), []
    for command in commands:
        state = _advance(actuator, state, jnp.array([command]), jnp.asarray(step))
        drives.append(float(state.drive[0]))
    return np.array(drives)


@pytest.mark.parametrize("step", [0.01, 0.1, 0.5])
def test_a_follower_is_exact_for_any_step(step):
    count = round(2.0 / step)
    time = step * np.arange(1, count + 1)
    lagging = followed(follower(), [0.8] * count, step)
    np.testing.assert_allclose(lagging, 0.8 * (1 - np.exp(-time / 0.2)), rtol=1e-12)
    # at 1/s until 0.2 from the target, which the lag follows at that rate
    limited = followed(follower(max_rate=1.0), [0.8] * count, step)
    expected = np.where(time < 0.6, time, 0.8 - 0.2 * np.exp(-(time - 0.6) / 0.2))
    np.testing.assert_allclose(limited, expected, rtol=1e-9)
    np.testing.assert_allclose(followed(follower(lag=0.0), [0.8] * 3, step), 0.8)
    ramped = followed(follower(lag=0.0, max_rate=1.0), [0.8] * count, step)
    np.testing.assert_allclose(ramped, np.minimum(time, 0.8), rtol=1e-9)


@pytest.mark.parametrize("step", [0.01, 0.1])
def test_a_follower_is_exact_along_a_straight_schedule(step):
    actuator = eqx.tree_at(lambda f: f.values, follower(), jnp.array([[0.0, 0.5]]))
    found = followed(actuator, [0.0] * round(1.0 / step), step)
    time = step * np.arange(1, found.size + 1)
    np.testing.assert_allclose(found, 0.5 * (time - 0.2 * (1 - np.exp(-time / 0.2))), rtol=1e-9)


def test_a_follower_stays_within_its_limits_and_dead_band():
    given = followed(follower(lag=0.0, dead_band=0.1), [0.5, 0.55, 0.58, 0.65, 5.0, -3.0], 0.1)
    np.testing.assert_allclose(given, [0.5, 0.5, 0.5, 0.65, 1.0, 0.0])


def test_a_follower_at_its_target_has_a_slope():
    actuator = follower()

    def after(command):
        state = actuator.at_rest()
        return actuator.advance(state, command, jnp.asarray(0.1)).drive[0]

    assert float(jax.grad(after)(jnp.zeros(1))[0]) == pytest.approx(1 - np.exp(-0.5), rel=1e-12)


def test_a_command_adds_to_the_schedule_and_may_take_it_away():
    actuator = eqx.tree_at(lambda f: f.values, follower(lower=0.3), jnp.array([[0.5, 0.5]]))
    (given,) = actuator.inputs
    np.testing.assert_allclose([given.lower, given.upper], [-0.2, 0.5])
    np.testing.assert_allclose(followed(actuator, [0.0] * 3, 1.0), 0.5)
    np.testing.assert_allclose(followed(actuator, [-0.2] * 40, 1.0)[-1], 0.3)


@pytest.mark.release
def test_a_run_with_a_chamber_goes_on_from_where_it_stopped(tmp_path):
    half = held(0.5)
    described = scenario(
        nodes=4,
        base={"channels": {"slide": {}}},
        chamber=[chamber(schedule=half, min_pressure=0.2 * PRESSURE)],
        tendon=[WINCH | {"pair": True, "schedule": half, "name": "winch"}],
        control={"kind": "pid", "compare": False, "pid": {"slide": {"kp": 0.1}}},
        simulation={"duration": 0.2},
    )
    first = play(Prepared(described))
    # a controller of the base leaves the chamber as it is scheduled
    np.testing.assert_allclose(first.dataset["actuator_state"], 0.5)
    np.testing.assert_array_equal(first.dataset["actuator_command"], 0.0)
    longer = described.with_values({"simulation.duration": 0.4})
    whole, gone_on = play(Prepared(longer)), play(Prepared(longer), resume=first)
    load = whole.dataset["line_load"]
    assert load.line.values.tolist() == ["winch", "winch_opposite"]
    assert load.line_unit.values.tolist() == ["N", "N"]
    assert (load.sel(line="winch") > 0).all()
    for name in ("position", "actuator_state", "line_load", "energy"):
        np.testing.assert_array_equal(gone_on.dataset[name], whole.dataset[name])


# --- the scenario ---------------------------------------------------------------------------------

MISTAKES = {
    "chamber.0.span: got 0.5; must be a pair of numbers": {"span": 0.5},
    "chamber.0.span: got [0.0, 1.0, 2.0]; must be a pair": {"span": [0.0, 1.0, 2.0]},
    "chamber.0.offset.1: got nan; must be a finite number": {"offset": [0.01, float("nan")]},
    'chamber.0.name: got "Heave"; must be a name of a-z': {"name": "Heave"},
    'chamber.0.name: got "slide"; must differ from the name of base.channels.slide': {
        "name": "slide"
    },
    "chamber.0.area: missing; must be given without max_curvature": {"area": None},
    "chamber.0.span: got [0.5, 0.5]; must be [a, b]": {"span": [0.5, 0.5]},
    "chamber.0.span: got [0.99, 1.0]; must begin below": {"span": [0.99, 1.0]},
    "chamber.0.angle_deg: got 90.0; must be 0 or 180": {"angle_deg": 90.0},
    "chamber.0.offset: got -0.01; must be 0 or more": {"offset": -0.01},
    "chamber.0.max_curvature: got 0; must be": {"max_curvature": 0},
    "chamber.0.area: got 0.0002; must be left out with max_curvature": {"max_curvature": 3.0},
    "chamber.0.min_pressure: got 50000.0; must be below": {"min_pressure": 5e4},
    "chamber.0.schedule.share.1: got 1.5; must": {"schedule": {"time": [0, 1], "share": [0, 1.5]}},
    "chamber.0.schedule.share.0: got -1.0; must": {"schedule": {"time": [0, 1], "share": [-1, 1]}},
    "chamber.0.schedule.share: got [0.0]; must have 2": {
        "schedule": {"time": [0, 1], "share": [0]}
    },
    'chamber.1.name: got "chamber_0"; must differ from': {"name": None},
    "chamber.0.max_volume: missing; must be a number above 0 (m3)": {"drive": "volume"},
    "chamber.0.max_flow: got 1.0; must be left out": {"max_flow": 1.0},
    "chamber.0.max_volume: got 0.0002; must be below 0.0001 (m3)": PUMP
    | {"max_volume": 2e-4, "pair": True, "max_pressure": None},
    "tendon.0.max_tension: missing; must be a number above 0 (N)": {},
    "tendon.0.max_shortening: missing; must be a number above 0 (m)": {"drive": "length"},
    "tendon.0.stiffness: missing; must be a number above 0 (N)": {"drive": "length"},
    "tendon.0.max_tension: got 2.0; must be left out": WINCH | {"max_tension": 2.0},
    "tendon.0.max_shortening: got 0.3; must be below 0.25 (m), the path": WINCH
    | {"max_shortening": 0.3, "span": [0.5, 1.0]},
    'tendon.0.drive: got "force"; must': {"drive": "force"},
    "tendon.0.friction: got -0.1; must": {"friction": -0.1},
}


@pytest.mark.parametrize("line", MISTAKES)
def test_a_mistake_gets_one_line(line):
    kind, number, _ = line.split(".", 2)
    usual = chamber() if kind == "chamber" else {"offset": OFFSET}
    table = {key: value for key, value in (usual | MISTAKES[line]).items() if value is not None}
    second = [chamber(name="chamber_0")] * (number == "1")
    with pytest.raises(crinoid.ScenarioError) as caught:
        scenario(**{kind: [table, *second]})
    assert any(each.startswith(line) for each in caught.value.lines), caught.value.lines
