"""Contact of the arm with itself and with the hull of its vehicle."""

from collections.abc import Iterator

from crinoid.scenario.errors import Mistake, got
from crinoid.scenario.model import Model, entry


class SelfContact(Model):
    """Contact between parts of the arm that are far from each other along it, and with the hull."""

    self_: bool = entry(False, "Whether the arm can touch itself, and a hull.", alias="self")
    friction: float = entry(0.0, "Coulomb's coefficient of friction, also on a hull.", ge=0)

    def _conflicts(self) -> Iterator[Mistake]:
        if self.friction and not self.self_:
            yield Mistake("friction", got(self.friction, "be 0 unless self = true"))
