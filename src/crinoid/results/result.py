"""The result of a run: an `xarray.Dataset` with units, and the state to go on from."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import xarray as xr

from crinoid.foundation.atomic_file import FilePath, atomic_write
from crinoid.foundation.representation import Represented
from crinoid.foundation.status import Status
from crinoid.foundation.version import __version__
from crinoid.results.readable import readable
from crinoid.results.result_checks import fault_of_run
from crinoid.results.result_file import CHECKPOINT, attributes, named_leaves, write_result
from crinoid.results.stream import (
    check_size,
    is_stream,
    open_lazily,
    read_checkpoint,
    remove_checkpoints,
)
from crinoid.scenario import Scenario, counted

if TYPE_CHECKING:
    from crinoid.results.scene.scene import Scene

RESULT = "result.nc"
UNCONTROLLED = "uncontrolled.nc"
TRAINING = "training.nc"
"""Names of the files of a run, of the same one without control, and of a policy's training."""
UNFINISHED = "unfinished: it is still run, or the program was killed; --resume goes on"
"""Status in a file that grows."""

Tree = TypeVar("Tree")


class ResultError(ValueError):
    """A file without a result, or with one that cannot be resumed."""


class Result(Represented):
    """A run: its data, how it ended, and the same case without control if that was run too.

    Parameters
    ----------
    dataset : xarray.Dataset
        Its data, in SI units and rad: variables over time, with the scenario among the attributes.
    checkpoint : mapping of str to array
        The arrays of the state at the end by their path, such as ``state.motion.position``; nothing
        where there is none to go on from.
    uncontrolled : Result
        The same case without control.

    Examples
    --------
    >>> scenario = crinoid.load("still-water", ["arm.nodes=5", "simulation.duration=0.2"])
    >>> result = crinoid.simulate(scenario)
    >>> result.dataset.position.sizes["node"], result.dataset.position.units
    (5, 'm')
    >>> [path.name for path in result.save("results/still-water")]
    ['result.nc', 'uncontrolled.nc']
    >>> crinoid.Result.load("results/still-water").status
    'ok'
    """

    def __init__(
        self,
        dataset: xr.Dataset,
        checkpoint: Mapping[str, np.ndarray] | None = None,
        uncontrolled: Result | None = None,
    ) -> None:
        self.dataset = dataset
        self.checkpoint = dict(checkpoint or {})
        self.uncontrolled = uncontrolled
        self.shapeless = 0
        """Saved instants of both that its data leave out, as the arm has no shape to draw."""
        self._scene: tuple[xr.Dataset, Result | None, Scene] | None = None

    @property
    def status(self) -> str:
        """``ok``, or what went wrong and when."""
        return str(self.dataset.attrs.get("status", "")).strip() or Status.OK.value

    @property
    def ended(self) -> Status | None:
        """How the run ended; None for an unknown status."""
        return Status.of(self.status)

    @property
    def notes(self) -> list[str]:
        """Notes on the run that its data do not give, a sentence each."""
        return str(self.dataset.attrs.get("notes", "")).splitlines()

    @property
    def digests(self) -> dict[str, str]:
        """The SHA-256 digest of each file that the run was made from."""
        lines = str(self.dataset.attrs.get("files", "")).splitlines()
        return {file: digest for digest, _, file in (line.partition("  ") for line in lines)}

    @property
    def failure(self) -> str:
        """Failure of this run or of the one without control; empty if neither failed."""
        other = self.uncontrolled.failure if self.uncontrolled is not None else ""
        return self.status if self.ended is Status.FAILED else other

    @property
    def interrupted(self) -> bool:
        """Whether this run or the one without control was stopped before its end."""
        other = self.uncontrolled is not None and self.uncontrolled.interrupted
        return self.ended in (Status.INTERRUPTED, Status.UNFINISHED) or other

    @property
    def scenario(self) -> Scenario:
        """The scenario that was run."""
        text = str(self.dataset.attrs["scenario"])
        scenario, reason = readable(text)
        return scenario if scenario is not None and not reason else Scenario.from_toml(text)

    @property
    def readable(self) -> tuple[Scenario | None, str]:
        """The scenario without what this version does not know, None where it cannot read it.

        With it the reason why it is not the whole; empty if it is.
        """
        text = self.dataset.attrs.get("scenario")
        return (None, "its file has none") if text is None else readable(str(text))

    @property
    def known_scenario(self) -> Scenario:
        """What this version can read of the scenario, to draw its result; else one of defaults."""
        return self.readable[0] or Scenario()

    @property
    def title(self) -> str:
        """Title of the scenario, or the name of the program where it has none."""
        return str(self.dataset.attrs.get("title", "")).strip() or "crinoid"

    @property
    def members(self) -> list[tuple[str, Result]]:
        """The run and the one without control, each with its name; no name where it is alone."""
        if self.uncontrolled is None:
            return [("", self)]
        return [("with control", self), ("without control", self.uncontrolled)]

    @property
    def left_out(self) -> list[str]:
        """Notes on saved instants and parts of the scenario that are not drawn."""
        notes, reason = [], self.readable[1]
        if self.shapeless:
            verb, many = ("are", "these") if self.shapeless > 1 else ("is", "it")
            count = counted(self.shapeless, "saved instant")
            notes.append(f"{count} {verb} left out: at {many} the arm has no shape to draw.")
        if reason:
            notes.append(
                f"This version cannot read the whole scenario, and ignores keys: {reason}."
            )
        return notes

    @property
    def scene(self) -> Scene:
        """The scene of both runs in three dimensions, at all instants and nodes.

        Raises
        ------
        ResultError
            If the result has no positions.
        """
        from crinoid.results.scene.scene import build_scene

        if "position" not in self.dataset:
            raise ResultError("the result has no position: output.variables leaves it out")
        of, both, _ = self._scene or (None, None, None)
        if of is not self.dataset or both is not self.uncontrolled:
            self._scene = self.dataset, self.uncontrolled, build_scene(self)
        assert self._scene is not None
        return self._scene[2]

    @property
    def plot(self) -> Any:
        """Its matplotlib plots, a `crinoid.view.notebook.Plots`, such as ``plot.tip_error()``."""
        from crinoid.view.notebook import Plots

        return Plots(self)

    def _representation(self) -> tuple[str, dict[str, str]]:
        from crinoid.results.representation import represent

        return represent(self)

    def _repr_html_(self) -> str:
        """Return it as notebooks show it: a small animation, and its numbers."""
        from crinoid.view.notebook import html_of

        return html_of(self)

    def restore(self, like: Tree) -> Tree:
        """Return the state at the end.

        Parameters
        ----------
        like : pytree of arrays
            State of the same shape.

        Returns
        -------
        pytree of arrays

        Raises
        ------
        ResultError
            If the state saved is of another version, or not of that shape.
        """
        version = self.dataset.attrs.get("crinoid_version")
        if version != __version__:
            raise ResultError(
                f"it was saved by crinoid {version} and this is {__version__}, "
                "which may compute otherwise. Run it again."
            )
        wanted, saved = named_leaves(like), self.checkpoint
        for name in dict.fromkeys([*wanted, *saved]):
            if _kind(wanted.get(name)) != _kind(saved.get(name)):
                raise ResultError(
                    "it holds no state that this scenario can go on from: of "
                    f"{name} it has {_kind(saved.get(name))}, not {_kind(wanted.get(name))}"
                )
        import jax
        import jax.numpy as jnp

        leaves = [jnp.asarray(saved[name]) for name in wanted]
        return jax.tree.unflatten(jax.tree.structure(like), leaves)

    def save(self, folder: FilePath) -> list[Path]:
        """Write ``result.nc``, and ``uncontrolled.nc`` if there is one.

        The files are replaced only once their successors are complete.

        Parameters
        ----------
        folder : str or path
            Folder, created if needed.

        Returns
        -------
        list of Path
            The files.

        Raises
        ------
        OSError
            If the folder cannot be written to, or the disk is full.
        """
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        runs = {RESULT: self}
        if self.uncontrolled is not None:
            runs[UNCONTROLLED] = self.uncontrolled
        with ExitStack() as stack:
            for name, run in runs.items():
                write_result(
                    run.dataset, run.checkpoint, stack.enter_context(atomic_write(folder / name))
                )
        if self.uncontrolled is None and attributes(folder / UNCONTROLLED):  # of an earlier run
            (folder / UNCONTROLLED).unlink()
        for name in (RESULT, UNCONTROLLED):
            remove_checkpoints(folder / name)
        return [folder / name for name in runs]

    @staticmethod
    def load(folder: FilePath, *, lazily: bool = False) -> Result:
        """Read what `save` wrote, or what a run has written so far that is not over.

        Parameters
        ----------
        folder : str or path
            Folder of the result, or its ``result.nc``.
        lazily : bool
            Whether large variables stay in their file until they are used.

        Returns
        -------
        Result

        Raises
        ------
        ResultError
            If there is no result in the folder, or none that this version can read.
        """
        folder = Path(folder)
        folder = folder.parent if folder.name == RESULT else folder
        result = _read(folder / RESULT, lazily)
        if (folder / UNCONTROLLED).exists():
            result.uncontrolled = _read(folder / UNCONTROLLED, lazily)
        return result


def _read(path: Path, lazily: bool) -> Result:
    try:
        dataset = open_lazily(path)
        if not lazily:
            dataset.load()
        if is_stream(path):
            checkpoint = read_checkpoint(path, dataset)
        else:
            with xr.open_dataset(path, engine="netcdf4", group=CHECKPOINT) as leaves:
                check_size(leaves, path)
                checkpoint = {str(name): leaf.values for name, leaf in leaves.data_vars.items()}
    except FileNotFoundError:
        raise ResultError(f"{path}: no such result") from None
    except Exception as error:  # a file that is broken makes its readers raise anything
        # of an OSError without its number and the name
        reason = next((each for each in error.args if isinstance(each, str)), repr(error))
        raise ResultError(f"{path}: not a result of crinoid ({reason})") from error
    result = Result(dataset, checkpoint)
    scenario, _ = result.readable
    chosen = scenario is not None and bool(scenario.output.variables)
    if fault := fault_of_run(dataset, positions=not chosen):
        raise ResultError(f"{path}: not a result of crinoid, {fault}")
    return result


def _kind(leaf: np.ndarray | None) -> str:
    if leaf is None:
        return "nothing"
    return f"an array {leaf.shape} of {leaf.dtype}" if leaf.ndim else f"a number, {leaf.dtype}"
