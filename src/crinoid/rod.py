"""The arm at rest: where its nodes lie along its length, and what each section is made of."""

from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float


class Rod(eqx.Module):
    """Reference shape and sections of a planar arm of ``n`` nodes and ``e = n - 1`` edges.

    Edges carry what resists stretch, nodes what resists bending and what the water sees. Each
    node owns half of each edge beside it (half as much at both ends), so that sums over nodes are
    trapezoid rules: second order in the edge length.
    """

    rest_length: Float[Array, " e"]
    """Length of each edge at rest (m)."""
    EA: Float[Array, " e"]
    """Stretching stiffness at the middle of each edge (N)."""
    EI: Float[Array, " n"]
    """Bending stiffness at each node (N m2)."""
    rest_curvature: Float[Array, " n"]
    """Curvature without load, positive from +x toward +z (1/m)."""
    damping_time: Float[Array, ""]
    """Viscosity over modulus of the Kelvin-Voigt material (s)."""
    mass_per_length: Float[Array, " n"]
    """Mass per length (kg/m)."""
    diameter: Float[Array, " n"]
    """Diameter that the water sees (m)."""
    displaced_area: Float[Array, " n"]
    """Section area that displaces water (m2)."""

    @staticmethod
    def round(
        *,
        length: float | Array,
        nodes: int,
        radius: float | Sequence[float] | Array,
        density: float | Array,
        youngs_modulus: float | Array,
        rest_curvature: float | Array = 0.0,
        damping_time: float | Array = 0.0,
        EA: float | Array | None = None,
        EI: float | Array | None = None,
        mass_per_length: float | Array | None = None,
        diameter: float | Array | None = None,
        displaced_area: float | Array | None = None,
    ) -> "Rod":
        """Build an evenly divided arm of solid round sections.

        ``radius`` (m) is one number or ``(root, tip)``, tapering linearly. A section property
        that is given replaces, all along the arm, what radius, density and modulus would make it.
        """
        along_nodes = jnp.linspace(0.0, 1.0, nodes)
        along_edges = (along_nodes[1:] + along_nodes[:-1]) / 2
        root, tip = jnp.broadcast_to(jnp.asarray(radius, float), 2)

        def section(given: float | Array | None, round_: Array) -> Array:
            return round_ if given is None else jnp.full(round_.shape, given, float)

        at_nodes = root + (tip - root) * along_nodes
        at_edges = root + (tip - root) * along_edges
        area = jnp.pi * at_nodes**2
        return Rod(
            rest_length=jnp.full(nodes - 1, jnp.asarray(length, float) / (nodes - 1)),
            EA=section(EA, youngs_modulus * jnp.pi * at_edges**2),
            EI=section(EI, youngs_modulus * jnp.pi / 4 * at_nodes**4),
            rest_curvature=jnp.full(nodes, rest_curvature, float),
            damping_time=jnp.asarray(damping_time, float),
            mass_per_length=section(mass_per_length, density * area),
            diameter=section(diameter, 2 * at_nodes),
            displaced_area=section(displaced_area, area),
        )

    @property
    def nodes(self) -> int:
        """Number of nodes."""
        return self.EI.shape[0]

    @property
    def length(self) -> Float[Array, ""]:
        """Length at rest (m)."""
        return jnp.sum(self.rest_length)

    @property
    def arc_length(self) -> Float[Array, " n"]:
        """Distance of each node from the root, along the arm at rest (m)."""
        return jnp.concatenate([jnp.zeros(1), jnp.cumsum(self.rest_length)])

    @property
    def voronoi_length(self) -> Float[Array, " n"]:
        """Length that each node owns: half of each edge beside it (m)."""
        half = self.rest_length / 2
        return jnp.pad(half, (0, 1)) + jnp.pad(half, (1, 0))

    def rest_shape(self, tilt: float | Array) -> Float[Array, "n 2"]:
        """Return the nodes of the arm without load, its root at the origin and pointing at `tilt`.

        The turn at a node is the one whose bending strain ``2 tan(turn / 2)`` is that of rest
        (`crinoid.elements.elastic.Bend`).
        """
        turns = 2.0 * jnp.arctan(self.rest_curvature * self.voronoi_length / 2)
        angles = tilt + jnp.cumsum(turns[:-1])
        edges = self.rest_length[:, None] * jnp.stack([jnp.cos(angles), jnp.sin(angles)], axis=1)
        return jnp.concatenate([jnp.zeros((1, 2)), jnp.cumsum(edges, axis=0)])
