"""Names and units of what an environment is told and tells."""

from crinoid.environment.draws import Draws


class Named:
    """An environment whose observations and actions have names and units."""

    _draws: Draws

    @property
    def observation_names(self) -> tuple[str, ...]:
        """Name of each number of an observation."""
        return tuple(entry.name for entry in self._draws.observables.entries)

    @property
    def observation_units(self) -> tuple[str, ...]:
        """Unit of each of them."""
        return tuple(entry.unit for entry in self._draws.observables.entries)

    @property
    def action_names(self) -> tuple[str, ...]:
        """Name of the input that each number of an action commands."""
        return tuple(entry.name for entry in self._draws.observables.actions)

    @property
    def action_units(self) -> tuple[str, ...]:
        """Unit of each of them."""
        return tuple(entry.unit for entry in self._draws.observables.actions)
