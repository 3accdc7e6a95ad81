"""Allocation: inputs that are more than what is controlled share the work."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from crinoid.control.seen import Command
from crinoid.products import product, solve

_DAMPING = 1e-4
"""Squared share of the largest singular value by which the inverse of what is left is damped."""
_READY = 1e2
"""How much more readily an input moves that takes over than one that hands over."""
_RANK = 1e-9
"""Share of the largest singular value below which a direction counts as none."""


class Allocation(eqx.Module):
    """Shares of the inputs in what they do together.

    At rest, commands ``u`` move the pose by ``J u``; many of them move it alike. `within` keeps to
    the limits: of an input that would go beyond its own the others take over what they can, by
    least squares with weights (the cascaded generalised inverse of control allocation, Bodson
    2002). `handed` lets inputs go back to rest where others can do their part: of
    that change of the commands it leaves what does not move the pose (redundancy resolution,
    Liegeois 1977).
    """

    jacobian: Float[Array, "pose input"]
    """Movement of the pose by each input that is driven; 0 of what is not controlled."""
    scale: Float[Array, " pose"]
    """Length that makes an error of each coordinate one in metres."""
    weight: Command
    """How readily each input is used; 0 of one that is not driven."""
    release: Command
    """Rate at which an input goes back to where it rests (1/s); 0: it does not."""
    spare: Float[Array, "input input"]
    """Part of a change of the commands that does not move the pose."""

    @staticmethod
    def of(
        jacobian: Float[np.ndarray, "pose input"],
        scale: Float[np.ndarray, " pose"],
        weight: Float[np.ndarray, " input"],
        release: Float[np.ndarray, " input"],
    ) -> "Allocation":
        """Build the allocation from the static Jacobian."""
        # those that stay make room for those that go back
        ready = weight * np.where(release > 0, 1.0, _READY)
        weighed = scale[:, None] * jacobian * ready
        unmoved = np.eye(weight.size) - np.linalg.pinv(weighed, rcond=_RANK) @ weighed
        back = np.divide(1.0, ready, out=np.zeros_like(ready), where=ready > 0)
        spare = ready[:, None] * unmoved * back
        numbers = (jacobian, scale, weight, release, spare)
        return Allocation(*(jax.device_put(each) for each in numbers))

    def handed(self, command: Command) -> Command:
        """Return the rate of commands by which inputs go back and others take over (1/s)."""
        return -product(self.spare, self.release * command)

    def within(self, command: Command, lower: Command, upper: Command) -> Command:
        """Return commands within the limits that come next to what ``command`` does to the pose."""
        wanted = product(self.jacobian, command)

        def missed(held: Command) -> Float[Array, " pose"]:
            return self.scale * (wanted - product(self.jacobian, held))

        def share(_: Array, carry: tuple[Command, ...]) -> tuple[Command, ...]:
            best, held, weight = carry
            free = held + self._least(missed(held), weight)
            inside = (free >= lower) & (free <= upper)
            held = jnp.clip(free, lower, upper)
            better = jnp.sum(missed(held) ** 2) < jnp.sum(missed(best) ** 2)
            return jnp.where(better, held, best), held, jnp.where(inside, weight, 0.0)

        inside = (command >= lower) & (command <= upper)
        cut = jnp.clip(command, lower, upper)
        begin = cut, cut, jnp.where(inside, self.weight, 0.0)
        # each round one more coordinate may be left to fewer inputs
        return jax.lax.fori_loop(0, self.scale.size, share, begin)[0]

    def _least(self, missed: Float[Array, " pose"], weight: Command) -> Command:
        """Return the least commands, over their weights, that move the pose by ``missed`` (m)."""
        scaled = self.scale[:, None] * self.jacobian
        weighed = scaled * weight
        # above zero where no input is left
        damping = _DAMPING * jnp.sum(weighed**2) + _RANK * jnp.sum((scaled * self.weight) ** 2)
        squares = product(weighed, weighed.T) + damping * jnp.eye(self.scale.size)
        found = solve(squares, missed)
        return weight * product(weighed.T, found)
