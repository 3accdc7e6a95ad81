"""Kinds of tables: a list may have one built-in kind, and its build may name any argument."""

from typing import Annotated, Literal

import pytest
from pydantic import TypeAdapter, ValidationError

from crinoid.scenario.kinds import KindOf, part
from crinoid.tables import ActuatorTable


class Jet(ActuatorTable):
    kind: Literal["jet"] = "jet"


def test_a_list_may_have_one_kind_of_its_own():
    only = TypeAdapter(Annotated[Jet, KindOf("actuators", ActuatorTable)])
    assert only.validate_python({"kind": "jet"}) == Jet()
    with pytest.raises(ValidationError, match='kind: got "sail"; must be "jet"'):
        only.validate_python({"kind": "sail"})


def test_a_part_may_have_an_argument_called_name():
    assert part("builtins:dict", name="jet", places=3) == {"name": "jet", "places": 3}
