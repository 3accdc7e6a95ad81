"""Variables of a result: names, dimensions, units, meanings and computation.

The only list of them. It has no arrays: scenarios, which name variables, read it too.
"""

from collections.abc import Callable, Iterable, Mapping
from math import prod
from typing import Any, NamedTuple

Of = Callable[[Any], Any]  # from `crinoid.results.dataset.Instants` to values

LARGE = frozenset({"node", "edge"})  # dimensions that make a variable over time large


class Content(NamedTuple):
    """Part of a dataset before its conversion to xarray, where adding to one is slow."""

    variables: dict[str, tuple[Any, ...]]
    coordinates: dict[str, tuple[Any, ...]]


class Variable(NamedTuple):
    """A variable of a result."""

    name: str
    dims: tuple[str, ...]
    unit: str
    """Unit in CF notation; empty if a coordinate has that of each channel, reading or input."""
    meaning: str  # its ``long_name``
    of: Of | None = None
    """Its computation; None if in ``diagnostics.dimensionless`` or ``results.signals``."""
    where: str = ""  # words of what a result must have for it, such as "vehicle plane"
    more: str = ""  # addition to the meaning in the documentation
    extra: Mapping[str, str] = {}  # attributes besides unit and meaning

    @property
    def large(self) -> bool:
        """Whether it has numbers for each node or edge at each instant."""
        return "time" in self.dims and bool(LARGE & set(self.dims))


def _row(
    name: str, dims: str, unit: str, meaning: str, of: Of | None = None, **more: Any
) -> Variable:
    return Variable(name, tuple(dims.split()), unit, meaning, of, **more)


def _estimated(
    name: str, dims: str, unit: str, meaning: str, of: Callable[[Any, str], Any], where: str
) -> tuple[Variable, Variable]:
    """Return an estimate and its standard deviation."""
    whole, spread = f"estimated_{name}", f"standard deviation of estimated_{name}"
    return (
        _row(whole, dims, unit, f"estimated {meaning}", lambda run: of(run, "value"), where=where),
        _row(f"{whole}_std", dims, unit, spread, lambda run: of(run, "std"), where=where),
    )


_WHOLE = "of material, damping, tendons and chambers"
_FROM = "balances the moments at the two ends of an edge"


# fmt: off
VARIABLES = (
    _row("position", "time node axis", "m", "position of the nodes",
         lambda run: run.position, more="in the world"),
    _row("velocity", "time node axis", "m s-1", "velocity of the nodes",
         lambda run: run.kept.velocity),
    _row("acceleration", "time node axis", "m s-2", "acceleration of the nodes",
         lambda run: run.kept.acceleration),
    _row("tangent", "time edge axis", "1", "direction of the edges",
         lambda run: run.tangent, more="a unit vector toward the tip"),
    _row("curvature", "time node", "m-1", "curvature, positive from x toward z",
         lambda run: run.kept.curvature, where="plane"),
    _row("curvature", "time node bending", "m-1",
         "curvature, positive toward the directors m_1 and m_2",
         lambda run: run.kept.curvature, where="space",
         more="$\\kappa_1$ toward $m_1$, $\\kappa_2$ toward $m_2$"),
    _row("twist", "time edge", "rad m-1",
         "twist, positive from m_1 toward m_2 on the way to the tip",
         lambda run: run.twist, where="space",
         more="how fast the material turns about the arm; the mean of the two nodes"),
    _row("director", "time edge axis", "1",
         "director m_1 of the edges, which turns with the arm's material",
         lambda run: run.kept.director, where="space",
         more="a unit vector across the edge; $m_2$ is `tangent` $\\times$ `director`"),
    _row("tension", "time edge", "N", "axial force in the edges, tension positive",
         lambda run: run.tension, more="elastic and viscous"),
    _row("bending_moment", "time node", "N m", "bending moment, positive from x toward z",
         lambda run: run.bending_moment, where="plane", more=_WHOLE),
    _row("bending_moment", "time node bending", "N m",
         "bending moment, positive toward the directors m_1 and m_2",
         lambda run: run.bending_moment, where="space",
         more=f"of the edge beyond; {_WHOLE}"),
    _row("shear_force", "time edge", "N",
         "force across the edges of the arm beyond, positive to the side of x toward z",
         lambda run: run.shear_force, where="plane", more=_FROM),
    _row("shear_force", "time edge bending", "N",
         "force across the edges of the arm beyond, along the directors m_1 and m_2",
         lambda run: run.shear_force, where="space", more=_FROM),
    _row("tip_position", "time axis", "m", "position of the tip", lambda run: run.tip),
    _row("tip_target", "time axis", "m", "where the tip should be", lambda run: run.target),
    _row("tip_direction", "time axis", "1", "where the tip points",
         lambda run: run.kept.tip[:, 3:], where="space", more="a unit vector"),
    _row("tip_direction_target", "time axis", "1", "where the tip should point",
         lambda run: run.kept.reference[:, 3:], where="space", more="a unit vector"),
    _row("tip_angle", "time", "rad", "direction of the tip",
         lambda run: run.angle, where="plane", more="it turns on and on, without jumps"),
    _row("tip_angle", "time", "rad", "angle of the tip above the level plane",
         lambda run: run.elevation, where="space", more="between $-\\pi/2$ and $\\pi/2$"),
    _row("tip_angle_target", "time", "rad", "where the tip should point",
         lambda run: run.kept.reference[:, 2], where="plane"),
    _row("tip_error", "time", "m", "distance of the tip from where it should be",
         lambda run: run.tip_error, more="from `tip_position` to `tip_target`"),
    _row("flow_velocity", "time node axis", "m s-1",
         "velocity of the undisturbed water at the nodes", lambda run: run.kept.flow_velocity),
    _row("flow_speed", "time node", "m s-1", "speed of the undisturbed water at the nodes",
         lambda run: run.flow_speed, extra={"standard_name": "sea_water_speed"}),
    _row("reynolds_number", "time node", "1",
         "Reynolds number of the water's velocity relative to the arm",
         more="$\\lvert w\\rvert d/\\nu$, with the velocity $w$ of the water relative to the arm "
         "and $\\nu$ = `water.kinematic_viscosity`"),
    _row("reduced_velocity", "time node", "1",
         "relative velocity across the arm over first natural frequency and diameter",
         more="$\\lvert w_n\\rvert/(f_1 d)$, with the part $w_n$ of $w$ across the arm and the "
         "first natural frequency $f_1$"),
    _row("keulegan_carpenter", "node", "1",
         "Keulegan-Carpenter number of the swings of the relative velocity across the arm",
         more="$w_n$ in the whole run "
         "([Dimensionless numbers](../explanation/water.md#dimensionless-numbers))"),
    _row("natural_frequency", "mode", "Hz", "natural frequencies of the arm as it starts",
         more="in water, the slowest eight; 0 where it does not swing back"),
    _row("mode_shape", "mode node axis", "1", "how the nodes move in a mode, 1 at most"),
    _row("mode_spin", "mode edge", "rad m-1",
         "how the edges spin about themselves in a mode, for 1 m of mode_shape", where="space"),
    _row("base_command", "time channel", "", "command of the base channels, from the set pose",
         lambda run: run.kept.command, more="what the controller asks for"),
    _row("sensor_reading", "time reading", "", "newest known readings of the sensors",
         more="such as `tip.x`, `shape.curvature_0`"),
    _row("base_servo", "time channel", "", "displacement of the servos of the base channels",
         lambda run: run.kept.servo, more="they follow `base_command` within their limits"),
    _row("base_pose", "time channel", "",
         "displacement of the base channels from the set pose, prescribed motion included",
         lambda run: run.kept.pose),
    _row("channel_lower", "channel", "", "lower end of the travel of the servos",
         lambda run: run.limits[0], more="0 of a channel that stays put"),
    _row("channel_upper", "channel", "", "upper end of the travel of the servos",
         lambda run: run.limits[1], more="0 of a channel that stays put"),
    _row("channel_max_speed", "channel", "", "greatest speed of the servos",
         lambda run: run.limits[2], more="per s; 0 of a channel that stays put"),
    _row("channel_max_acceleration", "channel", "",
         "greatest acceleration of the servos",
         lambda run: run.limits[3], more="per s2; 0 of a channel that stays put"),
    _row("base_force", "time axis", "N", "force of the arm on its base",
         lambda run: run.kept.base_force),
    _row("base_moment", "time", "N m",
         "moment of the arm on its base about the root, positive from x toward z",
         lambda run: run.kept.base_moment, where="plane"),
    _row("base_moment", "time axis", "N m",
         "moment of the arm on its base about the root, right-handed",
         lambda run: run.kept.base_moment, where="space"),
    _row("energy", "time kind", "J", "stored energies, and works done on the arm since the start",
         lambda run: run.kept.energy),
    _row("steps", "time", "1", "time steps since the instant before",
         lambda run: run.kept.steps, more="a step cut in halves counts its parts"),
    _row("newton_iterations", "time", "1", "Newton iterations since the instant before",
         lambda run: run.kept.iterations, more="failed tries included"),
    _row("residual", "time", "N", "largest force imbalance of a node since the instant before",
         lambda run: run.kept.residual,
         more="that a step ended with, parts of a halved step included"),
    _row("step_error", "time", "m",
         "largest estimated local error of a step since the instant before",
         lambda run: run.kept.error,
         more="see [Error of a step](../explanation/integrator.md#error-of-a-step)"),
    _row("obstacle_position", "time obstacle axis", "m", "position of the obstacles",
         lambda run: run.kept.obstacle_position + run.origin, where="obstacles",
         more="in the world"),
    _row("obstacle_velocity", "time obstacle axis", "m s-1", "velocity of the obstacles",
         lambda run: run.kept.obstacle_velocity, where="obstacles"),
    _row("obstacle_spin", "time obstacle", "rad s-1",
         "angular velocity of the obstacles, positive from x toward z",
         lambda run: run.kept.obstacle_spin[..., 0], where="bodies plane"),
    _row("obstacle_spin", "time obstacle axis", "rad s-1",
         "angular velocity of the obstacles about the axes of the world, right-handed",
         lambda run: run.kept.obstacle_spin, where="bodies space"),
    _row("obstacle_axis", "time obstacle axis", "1", "direction of a line fixed to each obstacle",
         lambda run: run.kept.obstacle_axis, where="bodies",
         more="the axis of a capsule or cylinder in the plane or in space; else along x at first"),
    _row("contact_force", "time obstacle axis", "N", "force of the obstacles on the arm",
         lambda run: run.kept.touch.force, where="obstacles",
         more="friction included; the ball of a tool with a radius is part of the arm"),
    _row("contact_impulse", "time obstacle axis", "N s",
         "impulse of the obstacles on the arm since the start",
         lambda run: run.kept.touch.impulse, where="obstacles",
         more="the integral of the force over all time steps"),
    _row("contact_time", "time obstacle", "s",
         "time that the obstacles have been in contact since the start",
         lambda run: run.kept.touch.duration, where="obstacles"),
    _row("contact_gap", "time obstacle", "m", "distance of the obstacles from the arm's surface",
         lambda run: run.kept.gap.min(axis=-1), where="obstacles",
         more="negative where they overlap"),
    _row("contact_closest", "time obstacle", "m",
         "smallest distance of the obstacles from the arm's surface since the start",
         lambda run: run.kept.touch.closest, where="obstacles",
         more="at the end of any time step"),
    _row("tool_held", "time", "1", "whether the tip has the tool: 1, else 0",
         lambda run: run.kept.held, where="tool",
         more="as in the balance of forces then; the notes of a run tell the times of touches"),
    _row("vortex_force", "time edge axis", "N m-1", "force of shed vortices on a metre of arm",
         lambda run: run.kept.vortices.force, where="vortices",
         more="in the plane its part along the flow only"),
    _row("vortex_phase", "time edge", "rad", "phase of the lift of shed vortices",
         lambda run: run.kept.vortices.phase, where="vortices",
         more="turns on and on; in the plane that of the part along the flow"),
    _row("self_gap", "time edge", "m", "distance of the edges' surfaces from the nearest far edge",
         lambda run: run.kept.self_touch.gap, where="self",
         more="negative where they overlap, infinite of an edge without a far one"),
    _row("self_force", "time edge axis", "N", "force of far edges on the edges of the arm",
         lambda run: run.kept.self_touch.force, where="self", more="friction included"),
    _row("self_pairs", "time", "1", "number of pairs of far edges that press on each other",
         lambda run: run.kept.self_touch.pairs, where="self"),
    _row("hull_gap", "time edge", "m", "distance of the edges' surfaces from the hull",
         lambda run: run.kept.hull_touch.gap, where="hull",
         more="negative where they overlap, infinite of an edge too near to the root to touch it"),
    _row("hull_force", "time edge axis", "N", "force of the hull on the edges of the arm",
         lambda run: run.kept.hull_touch.force, where="hull", more="friction included"),
    _row("vehicle_pose", "time channel", "",
         "displacement of the vehicle from where it started, of its centre of mass",
         lambda run: run.kept.vehicle.pose, where="vehicle",
         more="and its turn; `base_pose` rides on it"),
    _row("thruster_force", "time axis", "N",
         "force of the thrusters along the axes of the vehicle",
         lambda run: run.kept.vehicle.force, where="vehicle"),
    _row("thruster_moment", "time", "N m",
         "moment of the thrusters on the vehicle, positive from x toward z",
         lambda run: run.kept.vehicle.moment[:, 0], where="vehicle plane"),
    _row("thruster_moment", "time axis", "N m",
         "moment of the thrusters about the axes of the vehicle, right-handed",
         lambda run: run.kept.vehicle.moment, where="vehicle space"),
    _row("estimate_time", "time", "s", "time of the newest command, which the estimate is of",
         lambda run: run.kept.estimate_time, where="estimate",
         more="nan before the first command, as all estimates"),
    *_estimated("tip_position", "time axis", "m", "position of the tip",
                lambda run, part: run.estimated_tip(part)[:, :run.dimension], "estimate"),
    *_estimated("tip_angle", "time", "rad", "direction of the tip",
                lambda run, part: run.estimated_tip(part)[:, 2], "estimate plane"),
    *_estimated("tip_direction", "time axis", "1", "direction of the tip; of nearly unit length",
                lambda run, part: run.estimated_tip(part)[:, 3:], "estimate space"),
    *_estimated("position", "time node axis", "m", "position of the nodes",
                lambda run, part: getattr(run.kept.estimate.position, part), "estimate shape"),
    *_estimated("flow_velocity", "time axis", "m s-1",
                "velocity of the undisturbed water, its mean along the arm",
                lambda run, part: getattr(run.kept.estimate.flow_velocity, part),
                "estimate current"),
    _row("surface_point", "surface_vertex surface_axis", "m",
         "corners of the surfaces of solids from files, from the positions of these",
         where="solids", more="along x, y and z, for drawing; of a planar arm a slab"),
    _row("surface_facet", "facet corner", "1", "numbers of the corners of each triangle",
         where="solids"),
    _row("facet_obstacle", "facet", "1", "index of the obstacle of each triangle", where="solids"),
    _row("actuator_command", "time input", "", "commands of the actuators", where="actuators"),
    _row("actuator_state", "time input", "", "what the actuators drive the arm with",
         where="actuators", more="their limits are the coordinates `input_lower`, `input_upper`"),
    _row("line_load", "time line", "",
         "tensions of tendons of given length, pressures of chambers of given volume",
         where="lines", more="above the surrounding pressure"),
)
# fmt: on
"""All of them, in the order of the documentation."""


def of_dimension(dimension: int, *, without: Iterable[str] = ()) -> dict[str, Variable]:
    """Return the variables of a planar (2) or spatial (3) arm by name.

    Those of "obstacles", "bodies" (free ones), "solids", "actuators", "tool", "lines", "vortices",
    "self", "hull" or "vehicle" in ``without`` are omitted.
    """
    left = {"space" if dimension == 2 else "plane", *without}
    return {each.name: each for each in VARIABLES if left.isdisjoint(each.where.split())}


def large_names(dimension: int, *, without: Iterable[str] = ()) -> list[str]:
    """Return the names of the large variables, which may be omitted."""
    there = of_dimension(dimension, without=without)
    return [name for name, each in there.items() if each.large]


def numbers(variables: Iterable[Variable], sizes: Mapping[str, int]) -> int:
    """Return the count of numbers of variables at an instant, from the sizes of dimensions.

    Unknown sizes count as 1.
    """
    over_time = (each for each in variables if "time" in each.dims)
    return sum(prod(sizes.get(dim, 1) for dim in each.dims if dim != "time") for each in over_time)


def quantity(name: str, values: Any, dimension: int) -> tuple[tuple[str, ...], Any, dict[str, str]]:
    """Return dimensions, values and attributes of a variable for xarray."""
    variable = of_dimension(dimension)[name]
    unit = {"units": variable.unit} if variable.unit else {}
    return variable.dims, values, unit | {"long_name": variable.meaning, **variable.extra}
