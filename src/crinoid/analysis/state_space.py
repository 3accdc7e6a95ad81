"""State-space model of arm, actuators and sensors, for the design of controllers elsewhere."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from jaxtyping import Complex, Float

from crinoid.analysis.model_files import FORMATS
from crinoid.analysis.sampled_plant import GROWS, System
from crinoid.assembly.linear import SHARE
from crinoid.foundation.atomic_file import FilePath, atomic_write
from crinoid.foundation.representation import Represented, cut_list, titled, with_units
from crinoid.foundation.version import __version__
from crinoid.numerics.signals_and_systems import Reduced, balanced_by_reach
from crinoid.results.dataset import described
from crinoid.scenario import one_of, refusal
from crinoid.scenario.errors import counted, got

if TYPE_CHECKING:
    import control

Names = tuple[str, ...]

RESPONSE = "response.nc"  # file of the response of the tip, which its figure shows
_GRID, _LOWEST = 600, 1e-4  # number of frequencies of that, and the lowest one over the highest
_ROUND_OFF = 1e-12  # Hankel singular value, over the largest, below which it is round-off
SWINGS = 1e-2  # share of the imaginary part of a pole above which a motion swings


@dataclass(frozen=True, repr=False)
class StateSpaceModel(Represented):
    """Linear model in discrete time: ``x' = A x + B u``, ``y = C x + D u``.

    States ``x``, inputs ``u`` and outputs ``y`` are deviations from the operating point. ``x'`` are
    the states one control period later, inputs are held for a period. SI units.
    """

    title: str
    """Title of the scenario."""
    A: Float[np.ndarray, "x x"]
    B: Float[np.ndarray, "x u"]
    C: Float[np.ndarray, "y x"]
    D: Float[np.ndarray, "y u"]
    period: float
    """Control period (s)."""
    current: Float[np.ndarray, " d"]
    """Steady current at the operating point (m/s)."""
    states: Names
    inputs: Names
    outputs: Names
    state_units: Names
    """Units, as in ``m s-1``; "1" without dimension, "" if unknown."""
    input_units: Names
    output_units: Names
    operating_states: Float[np.ndarray, " x"]
    """States at the operating point; zero in a reduced model."""
    operating_inputs: Float[np.ndarray, " u"]
    operating_outputs: Float[np.ndarray, " y"]
    input_scales: Float[np.ndarray, " u"]
    """Usual size of each input, for the Hankel singular values."""
    output_scales: Float[np.ndarray, " y"]
    """Usual size of each output: root sum of squares of its response to inputs of usual size."""
    hankel: Float[np.ndarray, " h"]
    """Hankel singular values of the full model between scaled inputs and outputs, largest first."""
    lasting: int
    """Number of states that do not decay, which have no such value."""
    error_bound: float = 0.0
    """Largest gain from scaled inputs to the error of scaled outputs that the reduction causes."""
    notes: Names = ()
    """Sentences on the operating point."""

    @staticmethod
    def of(system: System, **others: Any) -> StateSpaceModel:
        """Return the full model of a system, with its scales and Hankel singular values."""
        found, scales = _balanced(system, others["input_scales"])
        values, lasting = found.hankel, system.A.shape[0] - found.hankel.size
        scaled = {"output_scales": scales, "hankel": values, "lasting": lasting}
        return StateSpaceModel(**system._asdict(), **others, **scaled)

    def _representation(self) -> tuple[str, dict[str, str]]:
        return titled("Linear model", self.title, self.words), {
            "states": cut_list(with_units(self.states, self.state_units)),
            "inputs": cut_list(with_units(self.inputs, self.input_units)),
            "outputs": cut_list(with_units(self.outputs, self.output_units)),
            "poles": cut_list(dict.fromkeys(map(_pole, self.poles[self.poles.imag >= 0]))),
            "reduced": f"error bound {self.error_bound:.3g}" if self.error_bound else "",
        }

    @property
    def words(self) -> str:
        """Number of states, period, stability and current, in words."""
        current = ", ".join(f"{part + 0.0:.3g}" for part in self.current)
        stable = "stable" if self.stable else "unstable"
        states = counted(self.order, "state")
        return f"{states} over {self.period:g} s, {stable}, in water of {current} m/s"

    @property
    def order(self) -> int:
        """Number of states."""
        return self.A.shape[0]

    @cached_property
    def poles(self) -> Complex[np.ndarray, " pole"]:
        """Poles ``s`` (1/s) of ``exp(s t)``, the slowest first, except those gone at once."""
        found = np.linalg.eigvals(self.A).astype(complex)
        found = np.log(found[np.abs(found) > _ROUND_OFF]) / self.period
        return found[np.argsort(np.abs(found))]

    @property
    def stable(self) -> bool:
        """Whether no motion grows."""
        return bool(self.poles.real.max(initial=0.0) * self.period <= GROWS)

    @property
    def usual_order(self) -> int:
        """Order that keeps the Hankel singular values above 1e-5 of the largest, as LQG does."""
        return self.lasting + int(np.sum(self.hankel > SHARE * self.hankel.max(initial=0.0)))

    def reduced(self, order: int) -> StateSpaceModel:
        """Return a model of lower order, by balanced truncation (Moore 1981).

        States that do not decay remain. For inputs and outputs over their scales, the gain of the
        error at no frequency exceeds ``error_bound``, twice the sum of the Hankel singular values
        that are left out (Glover 1984).

        Raises
        ------
        ScenarioError
            If the model cannot have this order.
        """
        if self.order < self.lasting + self.hankel.size:
            raise refusal("order", got(order, "be left out of a reduced model"))
        least = max(1, self.lasting)
        most = self.lasting + int(np.sum(self.hankel > _ROUND_OFF * self.hankel.max(initial=0.0)))
        if not least <= order <= most:
            why = ", as the other states are round-off" if most < self.order else ""
            raise refusal("order", got(order, f"be {least} to {most}{why}"))
        found, _ = _balanced(self._system, self.input_scales, order - self.lasting)
        return replace(
            self,
            A=found.A,
            B=found.left @ self.B,
            C=self.C @ found.right,
            states=tuple(f"state_{index}" for index in range(order)),
            state_units=("",) * order,
            operating_states=np.zeros(order),
            error_bound=2 * float(self.hankel[order - self.lasting :].sum()),
        )

    @property
    def _system(self) -> System:
        return System(self.A, self.B, self.C, self.D)

    def response(self, frequency: Float[np.ndarray, " f"]) -> Complex[np.ndarray, "f output input"]:
        """Return the response of the outputs to the inputs at frequencies (Hz)."""
        return self._system.response(np.exp(2j * np.pi * frequency * self.period))

    def tip_response(self) -> xr.Dataset:
        """Return the response of the tip's position to all inputs over the frequency."""
        swings = self.poles[(self.poles.imag > 0) & (self.poles.real < 0)]
        near = np.abs(swings.imag) / (2 * np.pi)
        highest = 0.5 / self.period
        grid = np.geomspace(_LOWEST * highest, highest, _GRID)
        frequency = np.unique(np.concatenate([grid, near[(near > grid[0]) & (near < highest)]]))
        rows = [k for k, name in enumerate(self.outputs) if name in {f"tip_{a}" for a in "xyz"}]
        found = self.response(frequency)[:, rows]
        parts = [(f"response_{part}", "frequency output input", "", values,
                  f"response of the tip in m over an input in its unit, {part} part")
                 for part, values in (("real", found.real), ("imaginary", found.imag))]  # fmt: skip
        coords = [
            ("frequency", "frequency", "Hz", frequency, "frequency"),
            ("output", "output", "", [self.outputs[k] for k in rows], "coordinate of the tip"),
            ("input", "input", "", list(self.inputs), "input"),
            ("input_unit", "input", "", list(self.input_units), "unit of the input"),
        ]
        attributes = {"title": self.title, "crinoid_version": __version__, "order": self.order}
        return xr.Dataset(described(parts), described(coords), attributes)

    def to_control(self) -> control.StateSpace:
        """Return the model as one of python-control, with its names.

        Raises
        ------
        ImportError
            If python-control is not installed.
        """
        try:
            import control
        except ImportError as error:
            text = 'python-control is not installed: pip install "crinoid[control]"'
            raise ImportError(text) from error
        names = {kind: list(getattr(self, kind)) for kind in ("states", "inputs", "outputs")}
        return control.ss(self.A, self.B, self.C, self.D, self.period, name="plant", **names)

    def save(self, path: FilePath) -> None:
        """Write the model to a file for NumPy (.npz), MATLAB and Octave (.mat), or JSON (.json).

        All formats have the attributes of the model by their names, and ``stable``. Names and
        units are cell arrays in MATLAB, ``ss(A, B, C, D, period)`` is its model there.

        Raises
        ------
        ScenarioError
            If the ending is another one.
        """
        path = Path(path)
        write = FORMATS.get(path.suffix[1:])
        if write is None:
            endings = (f".{form}" for form in FORMATS)
            raise refusal("path", got(path.name, f"end with {one_of(endings)}"))
        values: dict[str, Any] = {"crinoid_version": __version__}
        values |= {each.name: getattr(self, each.name) for each in fields(self)}
        values["stable"] = self.stable
        with atomic_write(path) as temporary:
            write(temporary, values)


def _pole(pole: complex) -> str:
    """Return a pole in words, such as ``0.38 Hz (damping 0.05)``."""
    if pole.imag > SWINGS * abs(pole):
        damping = -pole.real / abs(pole)
        return f"{pole.imag / (2 * np.pi):.3g} Hz (damping {damping:.2g})"
    return f"fades in {-1 / pole.real:.2g} s" if pole.real < 0 else f"{pole.real:.2g} 1/s"


def _balanced(
    system: System, scales: Float[np.ndarray, " u"], most: int | None = None
) -> tuple[Reduced, Float[np.ndarray, " y"]]:
    size = system.A.shape[0] if most is None else most
    return balanced_by_reach(system.A, system.B * scales, system.C, share=_ROUND_OFF, most=size)
