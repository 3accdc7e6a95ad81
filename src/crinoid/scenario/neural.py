"""Settings of neural control."""

from typing import Annotated

from pydantic import Field

from crinoid.scenario.files import FileName
from crinoid.scenario.model import Model
from crinoid.scenario.quantity import Quantity

__all__ = ["Neural"]

_Weights = Annotated[FileName, Quantity(takes="the path of a file that crinoid train wrote")]


class Neural(Model):
    """Neural control: a network that was trained in simulation."""

    weights: _Weights | None = Field(
        default=None,
        description="File of the policy, as `crinoid train` writes it; kind neural takes one.",
    )
