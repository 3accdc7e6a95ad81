"""The arm at rest: where its nodes lie along its length, and what each section is made of."""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.frames import cross, transport


class Rod(eqx.Module):
    """Reference shape and sections of an arm of ``n`` nodes and ``e = n - 1`` edges.

    Edges carry what resists stretch, nodes what resists bending. What has a value per length at the
    nodes runs linearly between them. Each node owns half of each edge beside it.

    A spatial arm bends toward both directors of its material frame, m_1 and m_2, and twists.
    """

    rest_length: Float[Array, " e"]
    """Length of each edge at rest (m)."""
    EA: Float[Array, " e"]
    """Stretching stiffness at the middle of each edge (N)."""
    EI: Float[Array, "n ..."]
    """Bending stiffness at each node (N m2); in space toward m_1 and toward m_2."""
    rest_curvature: Float[Array, "n ..."]
    """Curvature without load (1/m), positive from +x toward +z; in space toward m_1 and m_2."""
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
    rest_twist: Float[Array, " n"] | None = None
    """Twist without load, from m_1 toward m_2 (rad/m)."""
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
            return Rod(EI=section(EI, bending), rest_curvature=jnp.full(nodes, rest), **common)
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
    def axes(self) -> int:
        """Number of axes that the arm moves along: 2 or 3."""
        return 2 if self.GJ is None else 3

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

    @property
    def strain_length(self) -> Float[Array, "n strain"]:
        """Length over which each node gathers its bend, or both of them and the twist (m).

        For the twist that which it owns. For a bend this with the end correction of Gregory's rule
        at the root (to second differences: Hildebrand 1974, Introduction to Numerical Analysis,
        chapter 5). There the moment is largest and falls steeply; the trapezoid rule would make an
        arm of 11 nodes a hundredth too soft. At the tip no moment is left to correct.
        """
        correction = self.rest_length[0] * jnp.array([-1 / 8, 1 / 6, -1 / 24])[: self.nodes]
        bent = self.voronoi_length.at[: correction.size].add(correction)
        lengths = [bent] if self.axes == 2 else [bent, bent, self.voronoi_length]
        return jnp.stack(lengths, axis=1)

    @property
    def rest_strain(self) -> Float[Array, "n strain"]:
        """Curvature without load (1/m); in space both and the twist (rad/m)."""
        if self.rest_twist is None:
            return self.rest_curvature[:, None]
        return jnp.concatenate([self.rest_curvature, self.rest_twist[:, None]], axis=1)

    @property
    def chord_length(self) -> Float[Array, " e"]:
        """Distance of the ends of each edge without load (m).

        An edge stands for a piece of a curve, in space of a helix with the mean of the strains at
        its two nodes: the nodes then lie on the natural shape itself.
        """
        strain = _between(self.rest_strain)
        share, rest = _of_arc(0.5 * self.rest_length, jnp.sum(strain**2, axis=1))
        along = 0.0 if self.axes == 2 else rest * (1 + share) * strain[:, 2] ** 2
        return self.rest_length * jnp.sqrt(share**2 + along)

    @property
    def rest_turn(self) -> Float[Array, " n"]:
        """How far a planar arm turns at each node without load (rad)."""
        half = 0.5 * self.rest_length * _between(self.rest_curvature)
        return jnp.pad(half, (0, 1)) + jnp.pad(half, (1, 0))

    def rest_shape(self, tilt: float | Array) -> Float[Array, "n 2"]:
        """Return the nodes of a planar arm without load, its root at the origin."""
        angles = tilt + jnp.cumsum(self.rest_turn[:-1])
        edges = self.chord_length[:, None] * jnp.stack([jnp.cos(angles), jnp.sin(angles)], axis=1)
        return jnp.concatenate([jnp.zeros((1, 2)), jnp.cumsum(edges, axis=0)])

    def rest_frames(
        self, frame: Float[Array, "3 3"]
    ) -> tuple[Float[Array, "n 3"], Float[Array, "e 3"]]:
        """Return nodes and directors m_1 of a spatial arm without load, its root at the origin.

        The clamp's ``frame`` has the rows ``t, m_1, m_2``. Along an edge the frame turns steadily
        about an axis that it keeps; the edge has the director of its middle.
        """

        def follow(frame: Array, edge: tuple[Array, Array]) -> tuple[Array, tuple[Array, Array]]:
            length, (toward_1, toward_2, twist) = edge
            rate = toward_1 * frame[2] - toward_2 * frame[1] + twist * frame[0]
            middle = _turned(frame, 0.5 * length * rate)
            share, rest = _of_arc(0.5 * length, jnp.sum(rate**2))
            chord = length * (share * middle[0] + rest * twist * rate)
            tangent = chord / jnp.sqrt(jnp.sum(chord**2))
            director = transport(middle[1], middle[0], tangent)
            return _turned(middle, 0.5 * length * rate), (chord, director)

        _, (chords, directors) = jax.lax.scan(
            follow, frame, (self.rest_length, _between(self.rest_strain))
        )
        return jnp.concatenate([jnp.zeros((1, 3)), jnp.cumsum(chords, axis=0)]), directors


def _between(nodal: Float[Array, "n ..."]) -> Float[Array, "n-1 ..."]:
    return 0.5 * (nodal[:-1] + nodal[1:])


def _sinc(squared: Array) -> Array:
    """Return ``sin(a) / a`` of a squared angle, with derivatives at zero."""
    small = squared < 1e-3
    angle = jnp.sqrt(jnp.where(small, 1.0, squared))
    series = 1.0 - squared / 6 * (1.0 - squared / 20 * (1.0 - squared / 42))
    return jnp.where(small, series, jnp.sin(angle) / angle)


def _of_arc(half: Array, squared_rate: Array) -> tuple[Array, Array]:
    """Return ``q = sin(a) / a`` of half the angle ``a`` of an arc, and ``(1 - q) / rate^2``."""
    squared = squared_rate * half**2
    share, small = _sinc(squared), squared < 1e-3
    series = (1.0 - squared / 20 * (1.0 - squared / 42 * (1.0 - squared / 72))) / 6
    rest = (1.0 - share) / jnp.where(small, 1.0, squared)
    return share, half**2 * jnp.where(small, series, rest)


def _turned(frame: Float[Array, "3 3"], rotation: Float[Array, "3"]) -> Float[Array, "3 3"]:
    """Turn a frame by a rotation vector (Rodrigues's formula)."""
    squared = jnp.sum(rotation**2)
    swung = cross(rotation, frame)
    versine = 0.5 * _sinc(0.25 * squared) ** 2
    return frame + _sinc(squared) * swung + versine * cross(rotation, swung)
