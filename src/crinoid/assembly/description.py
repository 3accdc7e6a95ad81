"""Purpose and origin of a policy: the first line of its file."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple, NoReturn

from crinoid.foundation.version import __version__
from crinoid.scenario import ScenarioError, refusal
from crinoid.scenario.scenario import AT_REST

KEY = "control.neural.weights"  # key of a scenario that names such a file
POLICY = "policy.eqx"  # name under which a training writes one
_FORMAT = "crinoid-policy"
_VERSION = 1
PHYSICAL = (*AT_REST, "sensor", "sensors")  # tables of a scenario on which a policy was trained
_LONGEST = 1_000_000  # largest length of the first line (bytes)


class Description(NamedTuple):
    """Purpose and origin of a policy; read without JAX."""

    observations: list[list[str]]  # name and unit of each number that it observes
    actions: list[list[str]]  # name and unit of each number that it commands
    rate_hz: float  # commands a second
    averages: int  # number of times over which observations are averaged
    layers: list[int]  # outputs of each layer
    scenario: dict[str, Any]  # physical tables of the scenario that it was trained on
    draw: dict[str, list[float]]
    """Keys that each episode of its training drew, with the smallest and the largest value."""

    @property
    def line(self) -> bytes:
        """First line of its file."""
        about = {"format": _FORMAT, "version": _VERSION, "crinoid": __version__}
        return json.dumps(about | self._asdict()).encode() + b"\n"

    @staticmethod
    def of(path: Path) -> Description:
        """Read the description of a policy."""
        with opened(path) as file:
            return described(path, file)


def is_policy(path: Path) -> bool:
    """Return whether a file begins like a policy."""
    try:
        Description.of(path)
    except ScenarioError:
        return False
    return True


def described(path: Path, file: BinaryIO) -> Description:
    """Read the first line of a file."""
    try:
        head = json.loads(file.readline(_LONGEST))
        form, version = head["format"], head["version"]
    except (ValueError, KeyError, TypeError):  # ValueError: of the JSON and of its text
        form, version = None, None
    if form != _FORMAT:
        refuse(path, "is not a policy. Give a file that crinoid train wrote.")
    if version != _VERSION:
        refuse(path, f"has version {version} of the format; must be {_VERSION}. Train it again.")
    try:
        return Description(*(head[key] for key in Description._fields))
    except KeyError as error:
        refuse(path, f"is damaged: its first line lacks {error}")


@contextmanager
def opened(path: Path) -> Iterator[BinaryIO]:
    """Open the file of a policy, or refuse one that cannot be read."""
    try:
        with path.open("rb") as file:
            yield file
    except OSError as error:
        refuse(path, f"{error.strerror or error}. Give a file that crinoid train wrote.")


def refuse(path: Path, text: str) -> NoReturn:
    """Refuse a file."""
    raise refusal(KEY, f"{path}: {text}")
