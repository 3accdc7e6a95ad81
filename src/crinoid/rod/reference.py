"""Rod: its undeformed reference shape, and the properties of its sections."""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from crinoid.numerics.frames import rotated, sinc, transport
from crinoid.numerics.small_matrices import product

_ALONG = np.array([[1.0, 0.0], [0.5, 0.5], [0.0, 1.0]])
_SHARES = np.array([[1.0, 2.0, 0.0], [0.0, 2.0, 1.0]]) / 6
"""Of both ends in a force at start, middle and end, by Simpson's rule."""


class Reference(eqx.Module):
    """Undeformed arm: ``n`` nodes and ``e = n - 1`` edges along a curve, without stiffness.

    Statics and runs from rest start from it, and strains refer to its lengths. The elements have
    the stiffness.
    """

    rest_length: Float[Array, " e"]
    """Length of each edge at rest (m)."""
    rest_curvature: Float[Array, "n ..."]
    """Curvature without load (1/m), positive from +x toward +z; in space toward m_1 and m_2."""
    rest_twist: Float[Array, " n"] | None
    """In space, twist without load, from m_1 toward m_2 (rad/m)."""

    @property
    def axes(self) -> int:
        """Number of axes that the arm moves along: 2 or 3."""
        return 2 if self.rest_twist is None else 3

    @property
    def nodes(self) -> int:
        """Number of nodes."""
        return self.rest_length.shape[0] + 1

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
        """Voronoi length of each node: half of each adjacent edge (m)."""
        half = self.rest_length / 2
        return jnp.pad(half, (0, 1)) + jnp.pad(half, (1, 0))

    @property
    def strain_length(self) -> Float[Array, "n strain"]:
        """Length over which each node integrates its bend, or both bends and the twist (m).

        For the twist the Voronoi length. For a bend this with the end correction of Gregory's rule
        at the root (to second differences: Hildebrand 1974, Introduction to Numerical Analysis,
        chapter 5). There the moment is largest and falls steeply; the trapezoid rule would make an
        arm of 11 nodes 1 % too soft. At the tip there is no moment to correct.
        """
        correction = self.rest_length[0] * jnp.array([-1 / 8, 1 / 6, -1 / 24])[: self.nodes]
        bent = self.voronoi_length + jnp.pad(correction, (0, self.nodes - correction.size))
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

        An edge represents a piece of a curve, in space of a helix with the mean of the strains at
        its two nodes: the nodes then lie on the natural shape itself.
        """
        strain = _between(self.rest_strain)
        share, rest = _of_arc(0.5 * self.rest_length, jnp.sum(strain**2, axis=1))
        along = 0.0 if self.axes == 2 else rest * (1 + share) * strain[:, 2] ** 2
        return self.rest_length * jnp.sqrt(share**2 + along)

    @property
    def rest_turn(self) -> Float[Array, " n"]:
        """Turn of a planar arm at each node without load (rad)."""
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

        The clamp's ``frame`` has the rows ``t, m_1, m_2``. Along an edge the frame rotates at a
        constant rate about a fixed axis; the edge has the director of its middle.
        """
        _, (chords, directors) = jax.lax.scan(
            _follow, frame, (self.rest_length, _between(self.rest_strain))
        )
        return jnp.concatenate([jnp.zeros((1, 3)), jnp.cumsum(chords, axis=0)]), directors


def _follow(
    frame: Float[Array, "3 3"], edge: tuple[Array, Array]
) -> tuple[Array, tuple[Array, Array]]:
    """Rotate the frame along an edge of given length and strains; return chord and director too.

    At module level it is traced and compiled only once.
    """
    length, (toward_1, toward_2, twist) = edge
    rate = toward_1 * frame[2] - toward_2 * frame[1] + twist * frame[0]
    middle = rotated(frame, 0.5 * length * rate)
    share, rest = _of_arc(0.5 * length, jnp.sum(rate**2))
    chord = length * (share * middle[0] + rest * twist * rate)
    tangent = chord / jnp.sqrt(jnp.sum(chord**2))
    director = transport(middle[1], middle[0], tangent)
    return rotated(middle, 0.5 * length * rate), (chord, director)


def _between(nodal: Float[Array, "n ..."]) -> Float[Array, "n-1 ..."]:
    return 0.5 * (nodal[:-1] + nodal[1:])


def _of_arc(half: Array, squared_rate: Array) -> tuple[Array, Array]:
    """Return ``q = sin(a) / a`` of half the angle ``a`` of an arc, and ``(1 - q) / rate^2``."""
    squared = squared_rate * half**2
    share, small = sinc(squared), squared < 1e-3
    series = (1.0 - squared / 20 * (1.0 - squared / 42 * (1.0 - squared / 72))) / 6
    rest = (1.0 - share) / jnp.where(small, 1.0, squared)
    return share, half**2 * jnp.where(small, series, rest)


class Rod(Reference):
    """Reference shape and sections of an arm of ``n`` nodes and ``e = n - 1`` edges.

    Edges have the stretching stiffness, nodes the bending stiffness. The radius is linear between
    the nodes, and areas are its square. Each node owns half of each adjacent edge.

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
    """Hydrodynamic diameter (m)."""
    displaced_area: Float[Array, " n"]
    """Section area that displaces water (m2)."""
    edge_mass: Float[Array, "e 3"]
    """Mass per length at the start, the middle and the end of each edge, times its length (kg)."""
    edge_volume: Float[Array, "e 3"]
    """Area that displaces water at the same places, times the length of the edge (m3)."""
    GJ: Float[Array, " n"] | None = None
    """Twisting stiffness at each node of a spatial arm (N m2)."""
    spin_inertia: Float[Array, " e"] | None = None
    """Moment of inertia of each edge about its axis, of a spatial arm (kg m2)."""
    relaxation: Float[Array, "2 branch"] | None = None
    """Of each Maxwell branch the modulus over the relaxed one (1) and the relaxation time (s)."""

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
        relaxation: Array | None = None,
    ) -> "Rod":
        """Build an evenly divided arm of solid round sections.

        ``radius`` (m) is one number or ``(root, tip)``, tapering linearly. A given section property
        replaces the one from radius, density and modulus, all along the arm. ``EA``, ``EI`` and
        ``GJ`` may be pairs at root and tip, linear in between. The arm is planar or
        spatial, with 2 or 3 ``axes``. In space ``EI`` may be a pair, toward m_1 and toward m_2, or
        two such pairs as rows, at root and tip, and
        ``rest_curvature`` the triple of both curvatures (1/m) and the twist (rad/m); one number is
        the curvature toward m_2, as in the plane. The rows of ``relaxation`` are
        those of `crinoid.elements.Material`.
        """
        along_nodes = jnp.linspace(0.0, 1.0, nodes)
        root, tip = jnp.broadcast_to(jnp.asarray(radius, float), 2)

        def section(given: float | Array | None, round_: Array) -> Array:
            return round_ if given is None else jnp.full(round_.shape, given, float)

        def spread(given: float | Array | None, round_: Array, places: Array) -> Array:
            """Return a stiffness whose compliance over each piece of the arm is that of it all."""
            if given is None or jnp.ndim(given) == 0:
                return section(given, round_)
            ends = jnp.asarray(given)[0] + jnp.diff(jnp.asarray(given)) * places
            return logarithmic_mean(ends[:-1], ends[1:])

        at_nodes = root + (tip - root) * along_nodes
        start, end = at_nodes[:-1], at_nodes[1:]
        along = jnp.stack([start, (start + end) / 2, end], axis=1)
        bending = youngs_modulus * jnp.pi / 4 * at_nodes**4
        # over the length of a node: a torque twists it by the mean of 1 / r^4, as a pull stretches
        # an edge by that of 1 / r^2
        a, b = jnp.append(root, along[:, 1]), jnp.append(along[:, 1], tip)
        fourth = 3 * (a * b) ** 3 / (a**2 + a * b + b**2)
        modulus = youngs_modulus / 2 / (1 + jnp.asarray(poisson_ratio))
        edge = jnp.full(nodes - 1, jnp.asarray(length, float) / (nodes - 1))
        common = {
            "rest_length": edge,
            "EA": spread(EA, youngs_modulus * jnp.pi * start * end, along_nodes),
            "damping_time": jnp.asarray(damping_time, float),
            "mass_per_length": section(mass_per_length, density * jnp.pi * at_nodes**2),
            "diameter": section(diameter, 2 * at_nodes),
            "displaced_area": section(displaced_area, jnp.pi * at_nodes**2),
            "edge_mass": edge[:, None] * section(mass_per_length, density * jnp.pi * along**2),
            "edge_volume": edge[:, None] * section(displaced_area, jnp.pi * along**2),
        }
        rest = jnp.asarray(rest_curvature, float)
        if EI is not None and jnp.ndim(EI) == axes - 1:
            ends = jnp.asarray(EI, float)
            share = along_nodes if axes == 2 else along_nodes[:, None]
            EI = ends[0] + (ends[1] - ends[0]) * share
        if axes == 2:
            return Rod(
                EI=section(EI, bending),
                rest_curvature=jnp.full(nodes, rest),
                rest_twist=None,
                relaxation=relaxation,
                **common,
            )
        both = jnp.stack([bending, bending], axis=1)
        middles = (along_nodes[:-1] + along_nodes[1:]) / 2
        pieces = jnp.concatenate([along_nodes[:1], middles, along_nodes[-1:]])
        rest = rest if rest.shape == (3,) else jnp.zeros(3).at[1].set(rest)
        return Rod(
            EI=both if EI is None else jnp.broadcast_to(jnp.asarray(EI, float), both.shape),
            rest_curvature=jnp.broadcast_to(rest[:2], both.shape),
            GJ=spread(GJ, modulus * jnp.pi / 2 * fourth, pieces),
            rest_twist=jnp.full(nodes, rest[2]),
            # rho (I_1 + I_2), by Simpson's rule
            spin_inertia=product(common["edge_mass"] * along**2, jnp.array([1, 4, 1]) / 12),
            relaxation=relaxation,
            **common,
        )

    @property
    def edge_diameter(self) -> Float[Array, "e 3"]:
        """Hydrodynamic diameter at the start, the middle and the end of each edge (m)."""
        return jax.vmap(along)(jnp.stack([self.diameter[:-1], self.diameter[1:]], axis=1))

    @property
    def reference(self) -> Reference:
        """The undeformed arm, without the properties of its sections."""
        return Reference(self.rest_length, self.rest_curvature, self.rest_twist)


def logarithmic_mean(a: Float[Array, " n"], b: Float[Array, " n"]) -> Float[Array, " n"]:
    """Return ``(b - a) / ln(b / a)``, the logarithmic mean of two values."""
    skew = (b - a) / (b + a)
    small = skew**2 < 1e-4
    squared = jnp.where(small, skew**2, 0.0)
    series = 1 + squared * (1 / 3 + squared * (1 / 5 + squared * (1 / 7 + squared / 9)))
    apart = jnp.where(small, 0.5, skew)
    return 0.5 * (a + b) / jnp.where(small, series, jnp.arctanh(apart) / apart)


def along(ends: Float[Array, "2 ..."]) -> Float[Array, "3 ..."]:
    """Interpolate linearly: return the values at the start, the middle and the end."""
    return product(jnp.asarray(_ALONG), ends)


def shared(force: Float[Array, "3 ..."]) -> Float[Array, "2 ..."]:
    """Return the share of each end in a force given at start, middle and end (Simpson)."""
    return product(jnp.asarray(_SHARES), force)


def mass_matrices(mass: Float[Array, "edge 3"]) -> Float[Array, "edge 2 2"]:
    """Return the integrals of ``mass`` times the shares of two ends; it runs along a parabola."""
    start, middle = jnp.array([[9.0, 1.0], [1.0, -1.0]]), jnp.array([[12.0, 8.0], [8.0, 12.0]])
    return jnp.tensordot(mass, jnp.stack([start, middle, start[::-1, ::-1]]) / 60, 1)
