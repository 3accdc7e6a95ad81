"""The arm as it is made: its reference shape, and what each section is made of."""

from collections.abc import Sequence

import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.products import product
from crinoid.reference import Reference


class Rod(Reference):
    """Reference shape and sections of an arm of ``n`` nodes and ``e = n - 1`` edges.

    Edges carry what resists stretch, nodes what resists bending. The radius runs linearly between
    the nodes, and areas as its square. Each node owns half of each edge beside it.

    A spatial arm bends toward both directors of its material frame, m_1 and m_2, and twists.
    """

    EA: Float[Array, " e"]
    """Stretching stiffness of each edge (N)."""
    EI: Float[Array, "n ..."]
    """Bending stiffness at each node (N m2); in space toward m_1 and toward m_2."""
    damping_time: Float[Array, ""]
    """Viscosity over modulus of the Kelvin-Voigt material (s)."""
    mass_per_length: Float[Array, " n"]
    """Mass per length (kg/m)."""
    diameter: Float[Array, " n"]
    """Diameter that the water sees (m)."""
    displaced_area: Float[Array, " n"]
    """Section area that displaces water (m2)."""
    edge_mass: Float[Array, "e 3"]
    """Mass per length at the start, the middle and the end of each edge, times its length (kg)."""
    edge_volume: Float[Array, "e 3"]
    """Area that displaces water at the same places, times the length of the edge (m3)."""
    GJ: Float[Array, " n"] | None = None
    """Twisting stiffness at each node (N m2); of a spatial arm, like what follows."""
    spin_inertia: Float[Array, " e"] | None = None
    """Moment of inertia of each edge about itself (kg m2)."""

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
        axes: int = 2,
        poisson_ratio: float | Array = 0.5,
        GJ: float | Array | None = None,
    ) -> "Rod":
        """Build an evenly divided arm of solid round sections.

        ``radius`` (m) is one number or ``(root, tip)``, tapering linearly. A section property
        that is given replaces, all along the arm, what radius, density and modulus would make it.
        The arm is planar or spatial, of 2 or 3 ``axes``. In space ``EI`` may be a pair, toward m_1
        and toward m_2, and ``rest_curvature`` the triple of both curvatures (1/m) and the twist
        (rad/m); one number is that toward m_2, as in the plane.
        """
        along_nodes = jnp.linspace(0.0, 1.0, nodes)
        root, tip = jnp.broadcast_to(jnp.asarray(radius, float), 2)

        def section(given: float | Array | None, round_: Array) -> Array:
            return round_ if given is None else jnp.full(round_.shape, given, float)

        at_nodes = root + (tip - root) * along_nodes
        start, end = at_nodes[:-1], at_nodes[1:]
        along = jnp.stack([start, (start + end) / 2, end], axis=1)
        bending = youngs_modulus * jnp.pi / 4 * at_nodes**4
        # of what a node owns: a torque twists it by the mean of 1 / r^4, as a pull stretches an
        # edge by that of 1 / r^2
        a, b = jnp.append(root, along[:, 1]), jnp.append(along[:, 1], tip)
        fourth = 3 * (a * b) ** 3 / (a**2 + a * b + b**2)
        modulus = youngs_modulus / 2 / (1 + jnp.asarray(poisson_ratio))
        edge = jnp.full(nodes - 1, jnp.asarray(length, float) / (nodes - 1))
        common = {
            "rest_length": edge,
            "EA": section(EA, youngs_modulus * jnp.pi * start * end),
            "damping_time": jnp.asarray(damping_time, float),
            "mass_per_length": section(mass_per_length, density * jnp.pi * at_nodes**2),
            "diameter": section(diameter, 2 * at_nodes),
            "displaced_area": section(displaced_area, jnp.pi * at_nodes**2),
            "edge_mass": edge[:, None] * section(mass_per_length, density * jnp.pi * along**2),
            "edge_volume": edge[:, None] * section(displaced_area, jnp.pi * along**2),
        }
        rest = jnp.asarray(rest_curvature, float)
        if axes == 2:
            return Rod(
                EI=section(EI, bending),
                rest_curvature=jnp.full(nodes, rest),
                rest_twist=None,
                **common,
            )
        both = jnp.stack([bending, bending], axis=1)
        rest = rest if rest.shape == (3,) else jnp.zeros(3).at[1].set(rest)
        return Rod(
            EI=both if EI is None else jnp.broadcast_to(jnp.asarray(EI, float), both.shape),
            rest_curvature=jnp.broadcast_to(rest[:2], both.shape),
            GJ=section(GJ, modulus * jnp.pi / 2 * fourth),
            rest_twist=jnp.full(nodes, rest[2]),
            # rho (I_1 + I_2), by Simpson's rule
            spin_inertia=product(common["edge_mass"] * along**2, jnp.array([1, 4, 1]) / 12),
            **common,
        )

    @property
    def reference(self) -> Reference:
        """The arm without load, and nothing of what it is made of."""
        return Reference(self.rest_length, self.rest_curvature, self.rest_twist)
