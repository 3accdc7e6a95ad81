"""Work against precision: the time of a release over its error."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from benchmarks.engines import Engine
from benchmarks.measurement import Rows, Scope, row
from benchmarks.releases import RELEASES, Release
from benchmarks.step import march
from crinoid.assembly.prepared import system
from crinoid.compilation import OFTEN, compiled
from crinoid.dynamics import State, System
from crinoid.foundation.version import __version__
from crinoid.scenario import Scenario
from validation.peers.swing import Swing, Tips, clocked

_WITHIN = (0.01, 0.001)
"""Errors of the tip over its largest displacement."""
_LONGEST = 1.0
"""Time of a run from which on no longer one is tried (s)."""
_GAIN = 0.9
"""Ratio of errors above which a shorter time step no longer pays: the mesh decides."""
Start = Float[np.ndarray, " axis"]


@compiled(**OFTEN)
def _tips(
    system: System, state: State, samples: int, steps: Int[Array, ""]
) -> Float[Array, "sample pose"]:
    """Return the pose of the tip after each of some time steps; NaN from where one fails."""

    def to_sample(carry: tuple[State, Array], _: None) -> tuple[tuple[State, Array], Array]:
        state, converged = march(system, carry[0], jnp.zeros(len(system.inputs)), steps)
        converged &= carry[1]
        return (state, converged), jnp.where(converged, system.tip(state), jnp.nan)

    return jax.lax.scan(to_sample, (state, jnp.asarray(True)), length=samples)[1]


def _prepare(scenario: Scenario, time_step: float, interval: float, samples: int) -> Swing:
    arm = system(scenario)
    rest, origin = arm.rest(), np.asarray(arm.forces.origin)
    steps = jnp.asarray(round(interval / time_step))

    def swing() -> Tips:
        return np.asarray(_tips(arm, rest, samples, steps))[:, : origin.size] - origin

    swing()  # compiles
    return clocked(swing)


ENGINE = Engine(
    f"crinoid {__version__}",
    tuple(release.name for release in RELEASES),
    "shear, and inertia of the sections against tilting",
    order=2,
    meshes=(11, 21, 41, 81),
    steps=(0.05, 0.001),
    program=_prepare,
)


class _Run(NamedTuple):
    engine: str
    nodes: int
    time_step: float
    swing: Swing
    error: float
    seconds: float


def benchmark(scope: Scope) -> Rows:
    """Yield the fastest runs of each engine in each release, by their error.

    The error is the largest distance of the tip from the converged solution of the same engine,
    relative to the largest displacement.
    """
    for release in RELEASES:
        release = release._replace(duration=scope.duration or release.duration)
        engines = [ENGINE, *(peer for peer in scope.peers if release.name in peer.states)]
        arm = system(release.scenario(101))
        start = np.asarray(arm.tip(arm.rest())[: arm.forces.origin.size] - arm.forces.origin)
        truths, runs = {}, []
        for engine in engines:
            engine = engine._replace(meshes=engine.meshes[: scope.most and scope.most + 1])
            truths[engine.name] = _converged(engine, release)
            runs += _front(_tried(engine, release, truths[engine.name], start))
        # in turn: a busy machine slows all engines alike
        times = np.array([[run.swing()[1] for run in runs] for _ in range(scope.repeats)]).T
        for run, seconds in zip(runs, times, strict=True):
            at = {"nodes": run.nodes, "time_step": run.time_step, "error": run.error}
            yield row(release.name, "time of a run", "s", seconds, run.engine, **at)
        for engine in engines:
            own = [pair for pair in zip(runs, times, strict=True) if pair[0].engine == engine.name]
            for error in _WITHIN:
                within = [pair for pair in own if pair[0].error <= error]
                if not within:
                    name = f"{engine.name}, {release.name}"
                    yield f"{name}: no run of {_LONGEST:g} s is within {error:.1%}"
                    continue
                run, seconds = min(within, key=lambda pair: float(np.median(pair[1])))
                at = {"nodes": run.nodes, "time_step": run.time_step}
                yield row(release.name, f"time within {error:.1%}", "s", seconds, engine.name, **at)
        for name, truth in list(truths.items())[1:]:
            apart = _distance(truth, truths[ENGINE.name], start)
            yield row(release.name, "distance from crinoid's solution", "1", [apart], name)


def _converged(engine: Engine, release: Release) -> Tips:
    """Extrapolate a fine solution to no time step and no edge length, by the engine's orders."""
    *_, coarse, fine = engine.meshes
    step = engine.steps[1]
    finest, _ = engine.prepare(release, fine, step)()
    slower, _ = engine.prepare(release, fine, 2 * step)()
    coarser, _ = engine.prepare(release, coarse, step)()
    found = finest + (finest - slower) / (2**engine.order - 1)
    found = found + (finest - coarser) / ((fine / coarse) ** 2 - 1)
    if not np.isfinite(found).all():
        raise RuntimeError(f"{engine.name} fails {release.name} with {fine} nodes and {step} s")
    return found


def _distance(found: Tips, truth: Tips, start: Start) -> float:
    farthest = np.max(np.linalg.norm(truth - start, axis=1))
    return float(np.max(np.linalg.norm(found - truth, axis=1)) / farthest)


def _tried(engine: Engine, release: Release, truth: Tips, start: Start) -> list[_Run]:
    """Return runs of all meshes but the finest, with shorter and shorter time steps."""
    found = []
    for nodes in engine.meshes[:-1]:
        best, count = np.inf, round(release.interval / engine.steps[0])
        while (step := release.interval / count) >= engine.steps[1]:
            swing = engine.prepare(release, nodes, step)
            tip, seconds = min((swing(), swing()), key=lambda run: run[1])
            error = _distance(tip, truth, start)
            if np.isfinite(error):
                found.append(_Run(engine.name, nodes, step, swing, error, seconds))
                if error > _GAIN * best or error < 0.3 * _WITHIN[-1]:
                    break
                best = min(best, error)
            if seconds > _LONGEST:
                break
            count = round(np.ceil(1.4 * count))
    return found


def _front(runs: list[_Run]) -> list[_Run]:
    """Return runs of growing time, each of a clearly smaller error than the one before."""
    front: list[_Run] = []
    for run in sorted(runs, key=lambda run: run.seconds):
        if not front or run.error < _GAIN * front[-1].error:
            front.append(run)
    return front
