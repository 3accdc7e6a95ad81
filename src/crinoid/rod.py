"""The arm as it is made: its reference shape, and what each section is made of."""

from collections.abc import Sequence

import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.reference import Reference


class Rod(Reference):
    """Reference shape and sections of an arm of ``n`` nodes and ``e = n - 1`` edges.

    Edges carry what resists stretch, nodes what resists bending. What has a value per length at the
    nodes runs linearly between them. Each node owns half of each edge beside it.

    A spatial arm bends toward both directors of its material frame, m_1 and m_2, and twists.
    """

    EA: Float[Array, " e"]
    """Stretching stiffness at the middle of each edge (N)."""
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
        along_edges = (along_nodes[1:] + along_nodes[:-1]) / 2
        root, tip = jnp.broadcast_to(jnp.asarray(radius, float), 2)

        def section(given: float | Array | None, round_: Array) -> Array:
            return round_ if given is None else jnp.full(round_.shape, given, float)

        at_nodes = root + (tip - root) * along_nodes
        at_edges = root + (tip - root) * along_edges
        area = jnp.pi * at_nodes**2
        bending = youngs_modulus * jnp.pi / 4 * at_nodes**4
        twisting = bending / (1 + jnp.asarray(poisson_ratio))  # E / 2 (1 + nu) and pi / 2 r^4
        mass = section(mass_per_length, density * area)
        edge = jnp.full(nodes - 1, jnp.asarray(length, float) / (nodes - 1))
        common = {
            "rest_length": edge,
            "EA": section(EA, youngs_modulus * jnp.pi * at_edges**2),
            "damping_time": jnp.asarray(damping_time, float),
            "mass_per_length": mass,
            "diameter": section(diameter, 2 * at_nodes),
            "displaced_area": section(displaced_area, area),
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
            GJ=section(GJ, twisting),
            rest_twist=jnp.full(nodes, rest[2]),
            spin_inertia=0.25 * (mass[1:] + mass[:-1]) * edge * at_edges**2,  # rho (I_1 + I_2) l
            **common,
        )

    @property
    def reference(self) -> Reference:
        """The arm without load, and nothing of what it is made of."""
        return Reference(self.rest_length, self.rest_curvature, self.rest_twist)
