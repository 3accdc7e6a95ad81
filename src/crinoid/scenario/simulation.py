"""Simulation settings: time, time steps and solver, and the saved output."""

import math
from collections.abc import Iterable, Iterator
from typing import Annotated, Literal

from pydantic import Field

from crinoid.scenario.errors import Mistake, got
from crinoid.scenario.model import Model, entry
from crinoid.scenario.own_measure import OwnMeasure, own_measures
from crinoid.scenario.quantity import AsTuple, Quantity, Seconds

Integrator = Literal["newmark", "generalized-alpha", "implicit-euler"]

Gamma = Annotated[
    float,
    Field(ge=0.5),
    Quantity(expects="a number of 0.5 or more (with less, damping is negative: motion grows)"),
]

_OPTIONS: dict[Integrator, dict[str, float]] = {
    "newmark": {"beta": 0.25, "gamma": 0.5},
    "generalized-alpha": {"spectral_radius": 0.8},
    "implicit-euler": {},
}


_MAX_STEPS = 10**9


class Simulation(Model):
    """Time, time steps and the solver."""

    duration: Seconds = entry(20.0, "Simulated time; a whole number of time steps.", gt=0)
    time_step: Seconds = entry(0.01, "Time step.", gt=0)
    integrator: Integrator = entry("newmark", "Time integrator.")
    beta: float | None = entry(None, "Parameter beta of newmark; 0.25 by default.", gt=0)
    gamma: Gamma | None = entry(None, "Parameter gamma of newmark; 0.5 by default.")
    spectral_radius: float | None = entry(
        None,
        "Spectral radius of generalized-alpha for motion too fast to resolve: 1 keeps it, 0 "
        "removes it; 0.8 by default.",
        ge=0,
        le=1,
    )
    tolerance: float = entry(1e-8, "Relative residual of a converged step.", gt=0, le=1e-2)
    max_iterations: int = entry(20, "Greatest number of iterations of a step.", ge=1, le=1000)
    max_halvings: int = entry(12, "Greatest number of halvings of a failed step.", ge=0, le=16)
    error: float | None = entry(
        None,
        "Largest estimated local error of a step over arm.length; a step with more is halved. "
        "Off by default.",
        gt=0,
        le=1,
    )
    start: Literal["equilibrium", "rest"] = entry(
        "equilibrium", "equilibrium: still, under the loads of t = 0; rest: undeformed."
    )

    def _conflicts(self) -> Iterator[Mistake]:
        duration, step = self.duration, self.time_step
        if step > duration:
            yield Mistake("time_step", got(step, f"be at most duration = {duration} (s)"))
        elif duration / step > _MAX_STEPS:
            must = f"be at most {_MAX_STEPS:.0e} time steps ({_MAX_STEPS * step:.6g} s)"
            yield Mistake("duration", got(duration, must))
        else:
            yield from whole_conflicts("duration", duration, step)
        options = self.integrator_options
        for key in ("beta", "gamma", "spectral_radius"):
            value = getattr(self, key)
            if value is not None and key not in options:
                hint = f"Use {' and '.join(options)}." if options else ""
                text = got(value, f'be left out with integrator = "{self.integrator}"', hint)
                yield Mistake(key, text)
        if self.integrator == "newmark" and 2 * options["beta"] < options["gamma"]:
            beta, gamma = options["beta"], options["gamma"]
            hint = "Long time steps are unstable otherwise."
            if self.beta is None:
                yield Mistake("gamma", got(gamma, f"be at most 2 beta = {2 * beta:.6g}", hint))
            else:
                yield Mistake("beta", got(beta, f"be at least gamma / 2 = {gamma / 2:.6g}", hint))

    @property
    def integrator_options(self) -> dict[str, float]:
        """Options of the chosen integrator: beta and gamma, spectral_radius, or none."""
        given = {key: getattr(self, key) for key in _OPTIONS[self.integrator]}
        return _OPTIONS[self.integrator] | {k: v for k, v in given.items() if v is not None}

    @property
    def or_damping(self) -> str:
        """Words for an integrator that damps vibrations, after another remedy; empty with one."""
        return ', or simulation.integrator = "generalized-alpha"' * (self.integrator == "newmark")

    @property
    def steps(self) -> int:
        """Number of time steps."""
        return round(self.duration / self.time_step)


_Variables = Annotated[
    tuple[str, ...], AsTuple, Field(min_length=1), Quantity(expects="a list of names of variables")
]

_Function = Annotated[
    str, Field(pattern=r"^\w+(\.\w+)*:\w+$"), Quantity(expects="text as module:function")
]
_Functions = Annotated[
    tuple[_Function, ...],
    AsTuple,
    Quantity(
        expects='a list of functions of installed packages, such as "mypackage.measures:reach"'
    ),
]


class Output(Model):
    """Instants, variables and measures of a run that are saved."""

    interval: Seconds | None = entry(
        None,
        "Time between saved states, a whole number of time steps; by default the nearest to "
        "0.02 s.",
        gt=0,
    )
    variables: _Variables | None = entry(
        None,
        "Variables along the arm to save ([Result files and variables](result.md#variables)), all "
        "by default. Others are always saved.",
    )
    measures: _Functions = entry(
        (),
        "Further measures of a run: functions of installed packages, as module:function "
        "([Extend crinoid](../how-to/extending.md#a-measure)).",
    )

    def own_measures(self, known: Iterable[str]) -> dict[str, OwnMeasure]:
        """Return the further measures by name; none may have the name of one that is ``known``."""
        return own_measures(self.measures, known)


def whole_conflicts(key: str, time: float, time_step: float) -> Iterator[Mistake]:
    """Yield a time that is not a whole number of time steps, with the nearest ones."""
    steps = round(time / time_step)
    if steps > 0 and math.isclose(time / time_step, steps, abs_tol=1e-6):
        return
    below = math.floor(time / time_step)
    near = [f"{steps * time_step:.12g}" for steps in (below, below + 1) if steps > 0]
    must = f"be a whole number of time steps of {time_step} s"
    yield Mistake(key, got(time, must, f"Try {' or '.join(near)}."))
