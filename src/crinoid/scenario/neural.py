"""Settings of neural control."""

from __future__ import annotations

import os
from typing import Annotated

from pydantic import AfterValidator, Field

from crinoid.scenario.model import Model
from crinoid.scenario.quantity import Quantity

__all__ = ["Neural"]

_Weights = Annotated[
    str,
    Field(min_length=1),
    AfterValidator(lambda path: os.path.abspath(os.path.expanduser(path))),
    Quantity(takes="the path of a file that crinoid train wrote"),
]


class Neural(Model):
    """Neural control: a network that was trained in simulation."""

    weights: _Weights | None = Field(
        default=None,
        description="File of the policy, as `crinoid train` writes it; kind neural takes one.",
    )
