"""A scenario says what it takes, refuses the rest in one line, and survives being written."""

import itertools
import json
import math
import pickle
import tomllib
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from crinoid.scenario import (
    Arm,
    Base,
    Capsule,
    ChannelName,
    Channels,
    Coordinate,
    DistributedLoad,
    Pid,
    Plane,
    Scenario,
    ScenarioError,
    Simulation,
    TableMotion,
    Target,
    TipLoad,
    UniformFlow,
    builtin_files,
    builtin_names,
    builtin_text,
    json_schema,
    library,
    load,
)
from crinoid.scenario.control import COORDINATES
from crinoid.scenario.document import parse
from crinoid.scenario.files import anchor
from crinoid.scenario.quantity import unit_vector
from crinoid.space import CHANNELS

FULL = """
title = "Every table, \\"quoted\\" and all"
seed = 7
[arm]
length = 0.6
radius = [0.02, 0.01]
rest_curvature = -1
[arm.section]
EI = 0.0126
displaced_area = 0
[base]
position = [0.1, -5]
tilt_deg = -90
[base.channels.slide]
range = [-0.1, 0.3]
[base.channels.heave]
[base.channels.tilt]
range_deg = [0, 45]
[[base.motion]]
channel = "tilt"
kind = "sine"
amplitude_deg = 3.0
frequency_hz = 0.1
[[base.motion]]
channel = "heave"
kind = "table"
time = [0.0, 1.0, 2.0]
value = [0.0, 0.1, 0.0]
[water]
depth = 20
[[flow]]
kind = "shear"
velocity = [0.3, 0]
reference_depth = 1
roughness_length = 0.001
ramp_time = 0.5
[[flow]]
kind = "gust"
velocity = [0.1, 0.1]
duration = 1.5
[[flow]]
kind = "sine"
amplitude = [0, 0.1]
frequency_hz = 0.3333333333333333
[[flow]]
kind = "gauss-markov"
mean = [0.1, 0]
standard_deviation = [0.02, 0]
correlation_time = 2
[[flow]]
kind = "turbulence"
mean = [0.1, 0]
intensity = 0.1
length_scale = 0.5
modes = 64
[[flow]]
kind = "waves"
significant_height = 0.5
peak_period = 5
direction_deg = 180
[[load]]
kind = "distributed"
direction = "tangential"
magnitude = -0.1
[[load]]
kind = "tip"
moment = 1e-3
follower = true
[target]
time = [0, 1]
tip = [[0.6, -5], [0.5, -5.1]]
[sensor]
rate_hz = 50
[control]
kind = "pid"
controlled = ["x", "z", "angle"]
[control.pid.slide]
kp = 1
[control.pid.tilt]
ki = 0.30000000000000004
[simulation]
duration = 2
integrator = "generalized-alpha"
[output]
interval = 0.05
[vary]
"load.0.magnitude" = [0.25, 1]
"load.0.direction" = ["normal", [0.0, -1.0]]
"""


SPATIAL = """
[arm]
dimension = 3
rest_curvature = [0.1, -0.2, 0.3]
section = {EI = [0.02, 0.01], GJ = 0.005}
[base]
position = [0.1, 0.2, -5]
tilt_deg = -90
pan_deg = 30
roll_deg = 45
[base.channels]
roll = {range_deg = [-10, 20]}
sway = {}
pan = {}
slide = {}
[[base.motion]]
channel = "sway"
kind = "sine"
amplitude = 0.1
frequency_hz = 0.1
[[base.motion]]
channel = "roll"
kind = "table"
time = [0.0, 2.0]
value_deg = [0.0, 90.0]
[[flow]]
kind = "uniform"
velocity = [0.3, 0.1, 0]
[[flow]]
kind = "gauss-markov"
mean = [0.1, 0, 0]
standard_deviation = [0.02, 0.01, 0]
correlation_time = 2
[[flow]]
kind = "turbulence"
mean = [0, 0.1, 0]
intensity = 0.1
length_scale = 0.5
[[flow]]
kind = "measured"
file = "current.nc"
[[load]]
kind = "distributed"
direction = [0, 1, 1]
magnitude = -0.1
[[load]]
kind = "tip"
moment = [0, -1e-3, 0]
[[load]]
kind = "tip"
force = [0, 1, 0]
[[obstacle]]
kind = "cylinder"
position = [1, 0, -5]
axis = [0, 3, 4]
radius = 0.1
[[obstacle]]
kind = "plane"
position = [0, 0, -9]
normal = [0, 0, 2]
velocity = "flow"
[target]
time = [0, 1]
tip = [[0.6, 0, -5], [0.5, 0.1, -5.1]]
direction = [[1, 0, 0], [0, 3, 4]]
[control]
kind = "pid"
controlled = ["x", "y", "direction"]
[control.pid]
roll = {kp = 1}
pan = {kp = 1}
slide = {kp = 1}
[simulation]
duration = 2
"""


def refused(text: str) -> list[str]:
    with pytest.raises(ScenarioError) as caught:
        Scenario.from_toml(text)
    return caught.value.lines


ONE_MISTAKE = {
    "unknown key": (
        "arm.lenght = 0.5",
        "arm.lenght: unknown key; did you mean arm.length?",
    ),
    "unknown key in a list": (
        'flow = [{kind = "uniform", velocity = [0, 0], ramp = 1}]',
        "flow.0.ramp: unknown key; did you mean flow.0.ramp_time?",
    ),
    "unknown key like no other": (
        "output.zzz = 1",
        "output.zzz: unknown key, takes interval, variables",
    ),
    "unknown table": ("[watr]", "watr: unknown key; did you mean water?"),
    "wrong type": (
        'arm.length = "long"',
        'arm.length: got "long", takes a number above 0 (m)',
    ),
    "truth as a number": (
        "water.gravity = true",
        "water.gravity: got true, takes a number of 0 or more (m/s2)",
    ),
    "number as truth": ("control.compare = 1", "control.compare: got 1, takes true or false"),
    "fraction as a whole number": (
        "simulation.max_iterations = 2.5",
        "simulation.max_iterations: got 2.5, takes a whole number from 1 to 1000",
    ),
    "table as a number": (
        "arm.length.m = 1",
        "arm.length: got a table, takes a number above 0 (m)",
    ),
    "number as a table": ("arm = 3", "arm: got 3, takes a table"),
    "table as a list": (
        '[flow]\nkind = "uniform"',
        "flow: got a table, takes a list of tables, each under [[ ]]",
    ),
    "not a number": ("arm.length = nan", "arm.length: got nan, takes a finite number"),
    "infinite in a vector": (
        "base.position = [0.0, -inf]",
        "base.position.1: got -inf, takes a finite number",
    ),
    "infinite in a union": (
        "target.tip = [inf, 0.0]",
        "target.tip: got [inf, 0.0], takes finite numbers",
    ),
    "no viscosity": (
        "water.kinematic_viscosity = 0",
        "water.kinematic_viscosity: got 0, takes a number above 0 (m2/s)",
    ),
    "negative length": ("arm.length = -0.5", "arm.length: got -0.5, takes a number above 0 (m)"),
    "negative tip radius": (
        "arm.radius = [0.02, -0.01]",
        "arm.radius: got [0.02, -0.01], takes a number above 0, or [root, tip], both above 0 (m)",
    ),
    "two nodes": (
        "arm.nodes = 2",
        "arm.nodes: got 2, takes a whole number from 3 (an arm bends where edges meet) to 10000",
    ),
    "arm in spacetime": (
        "arm.dimension = 4",
        "arm.dimension: got 4, takes 2 (a planar arm) or 3 (an arm that bends both ways and "
        "twists)",
    ),
    "two stiffnesses in the plane": (
        "arm.section.EI = [0.02, 0.01]",
        "arm.section.EI: got [0.02, 0.01], takes a number above 0 (N m2); "
        "this one is for arm.dimension = 3",
    ),
    "twisted rest in the plane": (
        "arm.rest_curvature = [0, 1, 2]",
        "arm.rest_curvature: got [0.0, 1.0, 2.0], takes a number (1/m); "
        "this one is for arm.dimension = 3",
    ),
    "pan in the plane": ("base.pan_deg = 0", "base.pan_deg: got 0.0, needs arm.dimension = 3"),
    "sway in the plane": ("base.channels.sway = {}", "base.channels.sway: needs arm.dimension = 3"),
    "gains of roll in the plane": (
        "control.pid.roll.kp = 1",
        "control.pid.roll: needs arm.dimension = 3",
    ),
    "sway of the submarine in the plane": (
        'base.motion = [{kind = "sine", channel = "sway", amplitude = 1, frequency_hz = 1}]',
        'base.motion.0.channel: got "sway", takes "slide", "heave" or "tilt"; '
        "sway needs arm.dimension = 3",
    ),
    "direction in the plane": (
        "target.direction = [1, 0, 0]",
        "target.direction: got [1.0, 0.0, 0.0], but a planar arm takes angle_deg",
    ),
    "three names in the plane": (
        'flow = [{kind = "measured", file = "a.nc", velocity = ["u", "v", "w"]}]',
        'flow.0.velocity: got ["u", "v", "w"], takes a name for each of x, z; '
        "east, north and up go with heading_deg",
    ),
    "twist of a planar arm": (
        "arm.section.GJ = 0.01",
        "arm.section.GJ: got 0.01, but only a spatial arm twists",
    ),
    "vector too long": (
        'flow = [{kind = "uniform", velocity = [0.1, 0.0, 0.0]}]',
        "flow.0.velocity: got [0.1, 0.0, 0.0], takes [x, z] (m/s); "
        "this one is for arm.dimension = 3",
    ),
    "vector too short": (
        "base.position = [1.0]",
        "base.position: got [1.0], takes [x, z] (m)",
    ),
    "word in a vector": (
        'base.position = [1.0, "low"]',
        'base.position.1: got "low", takes a number (m)',
    ),
    "unknown kind": (
        'flow = [{kind = "tornado"}]',
        'flow.0.kind: got "tornado", takes "gauss-markov", "gust", "measured", "shear", "sine", '
        '"turbulence", "uniform" or "waves"',
    ),
    "no kind": (
        "load = [{magnitude = 1.0}]",
        'load.0.kind: missing, takes "distributed" or "tip"',
    ),
    "unknown controller": (
        'control.kind = "lqr"',
        'control.kind: got "lqr", takes "none", "pid", "lqg", "hybrid", "mpc", "neural" or '
        '"custom"',
    ),
    "missing key": (
        'load = [{kind = "distributed", direction = "normal"}]',
        "load.0.magnitude: missing, takes a number (N/m)",
    ),
    "no direction": (
        'load = [{kind = "distributed", direction = [0, 0], magnitude = 1}]',
        "load.0.direction: got [0.0, 0.0], takes a vector that is not 0",
    ),
    "empty tip load": (
        'load = [{kind = "tip"}]',
        "load.0.force: missing, a tip load takes force, moment or both",
    ),
    "zero time step": (
        "simulation.time_step = 0.0",
        "simulation.time_step: got 0.0, takes a number above 0 (s)",
    ),
    "time step beyond the end": (
        "simulation.time_step = 30.0",
        "simulation.time_step: got 30.0, takes up to duration = 20.0 (s)",
    ),
    "broken time step": (
        "simulation.time_step = 0.03",
        "simulation.duration: got 20.0, takes a whole number of time steps of 0.03 s; "
        "nearest 19.98 or 20.01",
    ),
    "negative damping": (
        "simulation.gamma = 0.4",
        "simulation.gamma: got 0.4, takes a number of 0.5 or more "
        "(with less, damping is negative: motion grows)",
    ),
    "unstable beta": (
        "simulation.beta = 0.2",
        "simulation.beta: got 0.2, takes gamma / 2 = 0.25 or more "
        "(else long time steps are unstable)",
    ),
    "unstable gamma": (
        "simulation.gamma = 0.6",
        "simulation.gamma: got 0.6, takes up to 2 beta = 0.5 (else long time steps are unstable)",
    ),
    "option of another integrator": (
        'simulation = {integrator = "implicit-euler", beta = 0.25}',
        'simulation.beta: does not go with integrator = "implicit-euler", '
        "which takes neither beta, gamma nor spectral_radius",
    ),
    "broken interval": (
        "output.interval = 0.025",
        "output.interval: got 0.025, takes a whole number of time steps of 0.01 s; "
        "nearest 0.02 or 0.03",
    ),
    "interval beyond the end": (
        "output.interval = 40.0",
        "output.interval: got 40.0, takes up to simulation.duration = 20.0 (s)",
    ),
    "fast sensor": (
        "sensor.rate_hz = 200",
        "sensor.rate_hz: got 200.0, takes up to 100 (Hz), once a time step "
        "(simulation.time_step = 0.01)",
    ),
    "range without zero": (
        "base.channels.slide.range = [0.1, 0.2]",
        "base.channels.slide.range: got [0.1, 0.2], "
        "takes [low, high] with low <= 0 <= high, not both 0",
    ),
    "angle in metres": (
        'base.motion = [{kind = "sine", channel = "tilt", amplitude = 1, frequency_hz = 1}]',
        'base.motion.0.amplitude: does not go with channel "tilt", which takes amplitude_deg',
    ),
    "no amplitude": (
        'base.motion = [{kind = "sine", channel = "heave", frequency_hz = 1}]',
        'base.motion.0.amplitude: missing, channel "heave" needs it',
    ),
    "motion that starts late": (
        'base.motion = [{kind = "table", channel = "heave", time = [1, 20], value = [0, 0]}]',
        "base.motion.0.time.0: starts at 1.0, takes 0 or before (s)",
    ),
    "motion that ends early": (
        'base.motion = [{kind = "table", channel = "heave", time = [0, 1], value = [0, 0]}]',
        "base.motion.0.time.1: ends at 1.0, takes simulation.duration = 20.0 or later (s)",
    ),
    "motion back in time": (
        'base.motion = [{kind = "table", channel = "heave", time = [0, 0, 20], value = [0, 0, 0]}]',
        "base.motion.0.time.1: got 0.0, takes a number above 0.0 (s)",
    ),
    "motion without a value": (
        'base.motion = [{kind = "table", channel = "heave", time = [0, 1, 20], value = [0, 0]}]',
        "base.motion.0.value: has 2 entries, takes 3, as time has",
    ),
    "motion of one value": (
        'base.motion = [{kind = "table", channel = "heave", time = [0, 20], value = [0]}]',
        "base.motion.0.value: has 1 entry, takes 2, as time has",
    ),
    "tilt of a pin": (
        'base = {mount = "pinned", channels = {tilt = {}}}',
        'base.channels.tilt: moves nothing: with base.mount = "pinned" the root turns freely',
    ),
    "shear without depth": (
        'flow = [{kind = "shear", velocity = [1, 0], reference_depth = 1}]',
        "water.depth: missing, takes a number above 0 (m): flow.0 needs it",
    ),
    "shear from below the bed": (
        'water.depth = 20\nflow = [{kind = "shear", velocity = [1, 0], reference_depth = 20}]',
        "flow.0.reference_depth: got 20.0, takes a number below water.depth = 20.0 (m)",
    ),
    "rough bed": (
        'water.depth = 20\n[[flow]]\nkind = "shear"\nvelocity = [1, 0]\nreference_depth = 15\n'
        "roughness_length = 5",
        "flow.0.roughness_length: got 5.0, takes a number below 5 (m), "
        "the height of reference_depth above the bed",
    ),
    "two profiles": (
        'water.depth = 20\n[[flow]]\nkind = "shear"\nvelocity = [1, 0]\nreference_depth = 0\n'
        "roughness_length = 0.1\nexponent = 0.2",
        "flow.0.exponent: does not go with roughness_length; takes one of the two",
    ),
    "waves without depth": (
        'flow = [{kind = "waves", significant_height = 1, peak_period = 6}]',
        "water.depth: missing, takes a number above 0 (m): flow.0 needs it",
    ),
    "waves higher than deep": (
        "water.depth = 2\nbase.position = [0, -1]\n"
        'flow = [{kind = "waves", significant_height = 2, peak_period = 6}]',
        "flow.0.significant_height: got 2.0, takes a number below water.depth = 2.0 (m)",
    ),
    "waves without gravity": (
        "water = {depth = 20, gravity = 0}\n"
        'flow = [{kind = "waves", significant_height = 1, peak_period = 6}]',
        "water.gravity: got 0.0, takes a number above 0 (m/s2): flow.0 needs it",
    ),
    "base above the waves": (
        "water.depth = 20\nbase.position = [0, 0]\n"
        'flow = [{kind = "waves", significant_height = 1, peak_period = 6}]',
        "base.position.1: got 0.0, takes a number below 0 (m): "
        "flow.0 has its still surface at z = 0",
    ),
    "flat spectrum": (
        'water.depth = 20\n[[flow]]\nkind = "waves"\nsignificant_height = 1\npeak_period = 6\n'
        "gamma = 0.5",
        "flow.0.gamma: got 0.5, takes a number from 1 to 10",
    ),
    "turbulence of nothing": (
        'flow = [{kind = "turbulence", mean = [0, 0], intensity = 0.2, length_scale = 1}]',
        "flow.0.mean: got [0.0, 0.0], takes a velocity other than 0: intensity is a share of it",
    ),
    "intensity in percent": (
        'flow = [{kind = "turbulence", mean = [1, 0], intensity = 20, length_scale = 1}]',
        "flow.0.intensity: got 20, takes a number above 0, up to 1",
    ),
    "too few modes": (
        'flow = [{kind = "turbulence", mean = [1, 0], intensity = 0.2, length_scale = 1, '
        "modes = 1}]",
        "flow.0.modes: got 1, takes a whole number from 8 to 10000",
    ),
    "negative deviation": (
        'flow = [{kind = "gauss-markov", mean = [1, 0], standard_deviation = [0.1, -0.1], '
        "correlation_time = 1}]",
        "flow.0.standard_deviation: got [0.1, -0.1], "
        "takes a number of 0 or more, or [x, z], both 0 or more (m/s)",
    ),
    "hasty wandering": (
        'flow = [{kind = "gauss-markov", mean = [1, 0], standard_deviation = 0.1, '
        "correlation_time = 1e-6}]",
        "flow.0.correlation_time: got 1e-06, takes 0.0004 or more (s): "
        "simulation.duration = 20.0 may hold 50000 of them",
    ),
    "base in the bed": (
        "water.depth = 9",
        "base.position.1: got -10.0; must be -water.depth = -9.0 or more (m), at the bed",
    ),
    "path without times": (
        "target.tip = [[0, 0], [1, 0]]",
        "target.time: missing, a path (tip) takes it (s)",
    ),
    "times without a path": (
        "target.time = [0, 1]",
        "target.time: goes with a path; takes tip or angle_deg as a list as long",
    ),
    "feed-forward without a controller": (
        'target = {path = "circle", radius = 0.1, period = 5, feed_forward = true}',
        'target.feed_forward: got true, goes with a controller; control.kind takes "pid" with it',
    ),
    "path too short": (
        "target = {time = [0, 1, 2], angle_deg = [0, 1]}",
        "target.angle_deg: has 2 entries, takes 3, as time has",
    ),
    "path before the start": (
        "target = {time = [-1, 1], angle_deg = [0, 1]}",
        "target.time.0: got -1.0, takes a number of 0 or more (s)",
    ),
    "path in a hurry": (
        "target = {time = [0, 1e-300], angle_deg = [0, 1]}",
        "target.time.1: got 1e-300, takes 1e-06 to 1e+09 s more than 0.0, the one before",
    ),
    "path for ever": (
        "target = {time = [0, 1e300], angle_deg = [0, 1]}",
        "target.time.1: got 1e+300, takes 1e-06 to 1e+09 s more than 0.0, the one before",
    ),
    "path in a far future": (
        "target = {time = [1e17, 1.00000001e17], angle_deg = [0, 1]}",
        "target.time.0: got 1e+17, takes a number from -1e+09 to 1e+09 (s)",
    ),
    "motion in a hurry": (
        'base.motion = [{kind = "table", channel = "heave", time = [0, 1e-300, 20], '
        "value = [0, 1, 0]}]",
        "base.motion.0.time.1: got 1e-300, takes 1e-06 to 1e+09 s more than 0.0, the one before",
    ),
    "line in no time": (
        'target = {path = "line", to = [0.4, -10], travel_time = 1e-300}',
        "target.travel_time: got 1e-300, takes a number from 1e-06 to 1000000000 (s)",
    ),
    "line that takes for ever": (
        'target = {path = "line", to = [0.4, -10], travel_time = 1e300}',
        "target.travel_time: got 1e+300, takes a number from 1e-06 to 1000000000 (s)",
    ),
    "line in a far future": (
        'target = {path = "line", to = [0.4, -10], travel_time = 1, start = 1e17}',
        "target.start: got 1e+17, takes a number from 0 to 1000000000 (s)",
    ),
    "directions of 0 where none go": (
        'arm.dimension = 3\n[target]\npath = "circle"\nradius = 0.1\nperiod = 5\n'
        "direction = [[0, 0, 1], [0, 1, 0]]",
        'target.direction: takes no list with path = "circle", which has its own points',
    ),
    "controlled twice": (
        'control.controlled = ["x", "x"]',
        'control.controlled: got ["x", "x"], takes each one once',
    ),
    "controls nothing": (
        "control.controlled = []",
        'control.controlled: got [], takes a list of "x", "z" and "angle"',
    ),
    "controls y": (
        'control.controlled = ["x", "y"]',
        'control.controlled.1: got "y", takes "x", "z" or "angle"',
    ),
    "pid without gains": (
        'control.kind = "pid"',
        'control.pid: missing, kind = "pid" takes gains for at least one input',
    ),
    "pid without its channel": (
        "control.pid.slide.kp = 1",
        "control.pid.slide: drives a channel that is not there; "
        "takes a table base.channels.slide with it",
    ),
    "identity without a partner": (
        "base.channels.slide = {}\nbase.channels.tilt = {}\n[control]\n"
        'mapping = "identity"\ncontrolled = ["x"]\npid = {slide = {}, tilt = {}}',
        'control.pid.tilt: mapping = "identity" takes "angle" in controlled along with it',
    ),
    "identity without a channel": (
        'base.channels.slide = {}\n[control]\nmapping = "identity"\npid = {slide = {}}',
        'control.controlled: "z" takes gains in pid.heave with mapping = "identity"',
    ),
    "negative seed": (
        "seed = -1",
        "seed: got -1, takes a whole number of 0 or more, below 9223372036854775808",
    ),
    "case out of bounds": (
        'vary = {"arm.nodes" = [11, 21], "arm.length" = [1.0, -1.0]}',
        "vary: case arm.nodes = 11, arm.length = -1.0: "
        "arm.length: got -1.0, takes a number above 0 (m)",
    ),
    "unknown obstacle": (
        'obstacle = [{kind = "box", position = [1, -10]}]',
        'obstacle.0.kind: got "box", takes "capsule", "cylinder", "plane" or "sphere"',
    ),
    "obstacle nowhere": (
        'obstacle = [{kind = "sphere", radius = 0.1}]',
        "obstacle.0.position: missing, takes [x, z] (m)",
    ),
    "obstacle without size": (
        'obstacle = [{kind = "sphere", position = [1, -10], radius = -0.1}]',
        "obstacle.0.radius: got -0.1, takes a number above 0 (m)",
    ),
    "obstacle of no size that is known": (
        'obstacle = [{kind = "cylinder", position = [1, -10], radius = nan}]',
        "obstacle.0.radius: got nan, takes a finite number",
    ),
    "point of a capsule": (
        'obstacle = [{kind = "capsule", position = [1, -10], radius = 0.1, length = 0}]',
        "obstacle.0.length: got 0, takes a number above 0 (m)",
    ),
    "axis of no direction": (
        'obstacle = [{kind = "cylinder", position = [1, -10], radius = 0.1, axis = [0, 0, 0]}]',
        "obstacle.0.axis: got [0.0, 0.0, 0.0], takes a vector that is not 0",
    ),
    "planar axis": (
        'obstacle = [{kind = "cylinder", position = [1, -10], radius = 0.1, axis = [1, 0]}]',
        "obstacle.0.axis: got [1, 0], takes [x, y, z]",
    ),
    "oblique axis": (
        'obstacle = [{kind = "cylinder", position = [1, -10], radius = 0.1, axis = [0, 1, 1]}]',
        "obstacle.0.axis: got [0.0, 1.0, 1.0], takes [0, 1, 0] or a vector with y = 0: oblique to "
        "the arm's plane its cut would be an ellipse",
    ),
    "wall without a front": (
        'obstacle = [{kind = "plane", position = [1, -10], normal = [0, 0]}]',
        "obstacle.0.normal: got [0.0, 0.0], takes a vector that is not 0",
    ),
    "wall to be pushed": (
        'obstacle = [{kind = "plane", position = [1, -10], normal = [0, 1], mass = 1}]',
        "obstacle.0.mass: unknown key, takes kind, position, velocity, friction, normal",
    ),
    "massless obstacle": (
        'obstacle = [{kind = "sphere", position = [1, -10], radius = 0.1, mass = 0}]',
        "obstacle.0.mass: got 0, takes a number above 0 (kg)",
    ),
    "obstacle with the wind": (
        'obstacle = [{kind = "sphere", position = [1, -10], radius = 0.1, velocity = "wind"}]',
        'obstacle.0.velocity: got "wind", takes [x, z] or "flow" (m/s)',
    ),
    "obstacle with one speed": (
        'obstacle = [{kind = "sphere", position = [1, -10], radius = 0.1, velocity = 0.1}]',
        'obstacle.0.velocity: got 0.1, takes [x, z] or "flow" (m/s)',
    ),
    "friction that speeds up": (
        'obstacle = [{kind = "sphere", position = [1, -10], radius = 0.1, friction = -0.1}]',
        "obstacle.0.friction: got -0.1, takes a number of 0 or more",
    ),
    "obstacle for an arm without surface": (
        "arm.section.diameter = 0\n"
        'obstacle = [{kind = "sphere", position = [1, -10], radius = 0.1}]',
        "arm.section.diameter: got 0.0, takes a number above 0 (m): the arm meets obstacles with "
        "this surface",
    ),
    "no cases": (
        'vary = {"arm.length" = []}',
        "vary.arm.length: got [], takes a list of one value or more",
    ),
    "more readings under way than are kept": (
        "sensor.delay = 200.0",
        "sensor.delay: got 200.0, takes up to 100 (s): at 100 Hz 10000 readings are under way then",
    ),
    "variables that there are not": (
        'output.variables = ["position", "twist"]',
        'output.variables.1: got "twist", takes "position", "velocity", "acceleration", "tangent", '
        '"curvature", "tension", "flow_velocity", "flow_speed", "reynolds_number" or '
        '"reduced_velocity"',
    ),
    "no variables": (
        "output.variables = []",
        "output.variables: got [], takes a list of names of variables",
    ),
    "a key below the last table": (
        '[vary]\n"arm.length" = [0.4]\ntitle = "mine"',
        'vary.title: got "mine", takes a list of one value or more; '
        "title itself stands above the first table",
    ),
    "a key of another table": (
        "tilt_deg = -30.0",
        "tilt_deg: unknown key; did you mean base.tilt_deg?",
    ),
    "a key of two tables": (
        "length = 0.5",
        "length: unknown key; did you mean arm.length or obstacle.0.length?",
    ),
    "a key of several tables": (
        "base.velocity = [0.1, 0.0]",
        "base.velocity: unknown key; did you mean base.motion.0.velocity, flow.0.velocity or "
        "obstacle.0.velocity?",
    ),
    "a key that is nearly one here and one elsewhere": (
        "simulation.time = [0.0, 1.0]",
        "simulation.time: unknown key; did you mean simulation.time_step, "
        "base.motion.0.time, flow.0.time or chamber.0.schedule.time?",
    ),
    "too many cases": (
        f'vary = {{"arm.length" = {[1.0] * 101}, "arm.density" = {[1.0] * 100}}}',
        "vary: makes 10100 cases, takes 10000 or fewer",
    ),
}


@pytest.mark.parametrize(("text", "line"), ONE_MISTAKE.values(), ids=ONE_MISTAKE.keys())
def test_a_mistake_gives_one_line(text, line):
    assert refused(text) == [line]


ONE_MISTAKE_IN_SPACE = {
    "planar velocity": (
        'flow = [{kind = "uniform", velocity = [0.2, 0.0]}]',
        "flow.0.velocity: got [0.2, 0.0], takes [x, y, z] (m/s): arm.dimension = 3",
    ),
    "planar position": (
        "base.position = [0.0, -10.0]",
        "base.position: got [0.0, -10.0], takes [x, y, z] (m): arm.dimension = 3",
    ),
    "vector of one": (
        "base.position = [1.0]",
        "base.position: got [1.0], takes [x, y, z] (m): arm.dimension = 3",
    ),
    "vector of four": (
        "base.position = [1.0, 2.0, 3.0, 4.0]",
        "base.position: got [1.0, 2.0, 3.0, 4.0], takes [x, y, z] (m): arm.dimension = 3",
    ),
    "word in a vector": (
        'base.position = [1.0, 0.0, "low"]',
        'base.position.2: got "low", takes a number (m)',
    ),
    "missing vector": (
        'flow = [{kind = "sine", frequency_hz = 1}]',
        "flow.0.amplitude: missing, takes [x, y, z] (m/s): arm.dimension = 3",
    ),
    "planar mean": (
        'flow = [{kind = "turbulence", mean = [0.1, 0], intensity = 0.1, length_scale = 1}]',
        "flow.0.mean: got [0.1, 0.0], takes [x, y, z] (m/s): arm.dimension = 3",
    ),
    "two deviations": (
        'flow = [{kind = "gauss-markov", mean = [1, 0, 0], standard_deviation = [0.1, 0.1], '
        "correlation_time = 1}]",
        "flow.0.standard_deviation: got [0.1, 0.1], takes a number of 0 or more, or [x, y, z], "
        "all 0 or more (m/s): arm.dimension = 3",
    ),
    "two names": (
        'flow = [{kind = "measured", file = "a.nc", velocity = ["u", "w"]}]',
        'flow.0.velocity: got ["u", "w"], takes a name for each of x, y, z',
    ),
    "two names of the compass": (
        'flow = [{kind = "measured", file = "a.nc", velocity = ["u", "w"], heading_deg = 0}]',
        'flow.0.velocity: got ["u", "w"], takes a name for each of east, north, up',
    ),
    "planar force": (
        'load = [{kind = "tip", force = [0, 1]}]',
        "load.0.force: got [0.0, 1.0], takes [x, y, z] (N): arm.dimension = 3",
    ),
    "planar moment": (
        'load = [{kind = "tip", moment = 0.1}]',
        "load.0.moment: got 0.1, takes [x, y, z] (N m): arm.dimension = 3",
    ),
    "planar direction of a load": (
        'load = [{kind = "distributed", direction = [0, 1], magnitude = 1}]',
        'load.0.direction: got [0.0, 1.0], takes "tangential", "normal" or [x, y, z]: '
        "arm.dimension = 3",
    ),
    "no direction of a load": (
        'load = [{kind = "distributed", direction = [0, 0, 0], magnitude = 1}]',
        "load.0.direction: got [0.0, 0.0, 0.0], takes a vector that is not 0",
    ),
    "planar obstacle": (
        'obstacle = [{kind = "sphere", position = [1, -10], radius = 0.1}]',
        "obstacle.0.position: got [1.0, -10.0], takes [x, y, z] (m): arm.dimension = 3",
    ),
    "planar drift": (
        'obstacle = [{kind = "sphere", position = [1, 0, -10], radius = 0.1, velocity = [1, 0]}]',
        'obstacle.0.velocity: got [1.0, 0.0], takes [x, y, z] or "flow" (m/s): arm.dimension = 3',
    ),
    "planar normal": (
        'obstacle = [{kind = "plane", position = [1, 0, -10], normal = [0, 1]}]',
        "obstacle.0.normal: got [0.0, 1.0], takes [x, y, z]: arm.dimension = 3",
    ),
    "planar target": (
        "target.tip = [0.5, -10.0]",
        'target.tip: got [0.5, -10.0], takes "initial", [x, y, z] or, with time, '
        "a list of [x, y, z] (m): arm.dimension = 3",
    ),
    "path that leaves space": (
        "target = {time = [0, 1], tip = [[0.5, 0.0, -10.0], [0.5, -10.0]]}",
        "target.tip: got [[0.5, 0.0, -10.0], [0.5, -10.0]], takes "
        '"initial", [x, y, z] or, with time, a list of [x, y, z] (m): arm.dimension = 3',
    ),
    "angle": (
        "target.angle_deg = 10",
        "target.angle_deg: got 10.0, but a spatial arm takes direction: arm.dimension = 3",
    ),
    "planar wanted direction": (
        "target.direction = [1, 0]",
        'target.direction: got [1, 0], takes "initial", [x, y, z] or, with time, a list of '
        "[x, y, z]",
    ),
    "no wanted direction": (
        "target = {time = [0, 1], direction = [[1, 0, 0], [0, 0, 0]]}",
        "target.direction.1: got [0.0, 0.0, 0.0], takes a vector that is not 0",
    ),
    "about turn": (
        "target = {time = [0, 1], direction = [[1, 0, 0], [-2, 0, 0]]}",
        "target.direction.1: got [-2.0, 0.0, 0.0], the opposite of the one before; "
        "takes one more between",
    ),
    "directions without times": (
        "target.direction = [[1, 0, 0], [0, 1, 0]]",
        "target.time: missing, a path (direction) takes it (s)",
    ),
    "no directions": (
        "target = {time = [], direction = []}",
        'target.direction: got [], takes "initial", [x, y, z] or, with time, a list of [x, y, z]',
    ),
    "times without a path": (
        "target.time = [0, 1]",
        "target.time: goes with a path; takes tip or direction as a list as long",
    ),
    "folded by itself": (
        "arm.nodes = 5\narm.rest_curvature = [30.0, 0.0, 100.0]",
        "arm.rest_curvature: turns the arm by 215 degrees at each node; takes up to 170: less, "
        "or more arm.nodes",
    ),
    "two rest curvatures": (
        "arm.rest_curvature = [1, 2]",
        "arm.rest_curvature: got [1, 2], takes a number or [kappa_1, kappa_2, twist], "
        "twist in rad/m (1/m): arm.dimension = 3",
    ),
    "three stiffnesses": (
        "arm.section.EI = [1, 2, 3]",
        "arm.section.EI: got [1, 2, 3], takes a number above 0, or [EI_1, EI_2], "
        "both above 0 (N m2): arm.dimension = 3",
    ),
    "no stiffness one way": (
        "arm.section.EI = [1, 0]",
        "arm.section.EI: got [1, 0], takes a number above 0, or [EI_1, EI_2], "
        "both above 0 (N m2): arm.dimension = 3",
    ),
    "no resistance to twist": (
        "arm.section.GJ = 0",
        "arm.section.GJ: got 0, takes a number above 0 (N m2)",
    ),
    "no pan": ("base.pan_deg = nan", "base.pan_deg: got nan, takes a finite number"),
    "roll in metres": (
        'base.motion = [{kind = "sine", channel = "roll", amplitude = 1, frequency_hz = 1}]',
        'base.motion.0.amplitude: does not go with channel "roll", which takes amplitude_deg',
    ),
    "sway in degrees": (
        'base.motion = [{kind = "sine", channel = "sway", amplitude_deg = 1, frequency_hz = 1}]',
        'base.motion.0.amplitude_deg: does not go with channel "sway", which takes amplitude',
    ),
    "unknown channel": (
        'base.motion = [{kind = "sine", channel = "yaw", amplitude = 1, frequency_hz = 1}]',
        'base.motion.0.channel: got "yaw", takes "slide", "sway", "heave", "pan", "tilt" or '
        '"roll": arm.dimension = 3',
    ),
    "angle controlled": (
        'control.controlled = ["x", "angle"]',
        'control.controlled.1: got "angle", takes "x", "y", "z" or "direction": arm.dimension = 3',
    ),
    "unknown coordinate": (
        'control.controlled = ["roll"]',
        'control.controlled.0: got "roll", takes "x", "y", "z" or "direction": arm.dimension = 3',
    ),
    "pid without its channel": (
        "control.pid.pan.kp = 1",
        "control.pid.pan: drives a channel that is not there; "
        "takes a table base.channels.pan with it",
    ),
    "identity with a turn": (
        "base.channels = {slide = {}, pan = {}}\n[control]\n"
        'mapping = "identity"\ncontrolled = ["x"]\npid = {slide = {}, pan = {}}',
        "control.pid.pan: turns the base, which goes with no one coordinate; "
        'mapping = "identity" takes slide, sway, heave',
    ),
    "identity with a direction": (
        "base.channels.slide = {}\n[control]\n"
        'mapping = "identity"\ncontrolled = ["x", "direction"]\npid = {slide = {}}',
        'control.controlled.1: got "direction", which does not go with mapping = "identity"; '
        'takes "x", "y" or "z"',
    ),
    "identity without sway": (
        "base.channels = {slide = {}, heave = {}}\n[control]\n"
        'mapping = "identity"\npid = {slide = {}, heave = {}}',
        'control.controlled: "y" takes gains in pid.sway with mapping = "identity"',
    ),
    "identity without y": (
        "base.channels = {slide = {}, sway = {}}\n[control]\n"
        'mapping = "identity"\ncontrolled = ["x"]\npid = {slide = {}, sway = {}}',
        'control.pid.sway: mapping = "identity" takes "y" in controlled along with it',
    ),
    "base in the bed": (
        "water.depth = 9",
        "base.position.2: got -10.0; must be -water.depth = -9.0 or more (m), at the bed",
    ),
    "base above the waves": (
        "water.depth = 20\nbase.position = [0, -5, 0]\n"
        'flow = [{kind = "waves", significant_height = 1, peak_period = 6}]',
        "base.position.2: got 0.0, takes a number below 0 (m): "
        "flow.0 has its still surface at z = 0",
    ),
    "unknown case": (
        'vary = {"base.position" = [[0, -5]]}',
        "vary: case base.position = [0, -5]: base.position: got [0.0, -5.0], "
        "takes [x, y, z] (m): arm.dimension = 3",
    ),
}


@pytest.mark.parametrize(
    ("text", "line"), ONE_MISTAKE_IN_SPACE.values(), ids=ONE_MISTAKE_IN_SPACE.keys()
)
def test_a_mistake_in_space_gives_one_line(text, line):
    assert refused(f"arm.dimension = 3\n{text}") == [line]


def test_each_vector_of_the_other_dimension_gives_its_line():
    planar = Scenario.from_toml(FULL).to_dict() | {"vary": {}}
    planar["arm"]["dimension"] = 3
    with pytest.raises(ScenarioError) as caught:
        Scenario.from_dict(planar)
    assert [mistake.key for mistake in caught.value.mistakes] == [
        "base.position",
        "flow.0.velocity",
        "flow.1.velocity",
        "flow.2.amplitude",
        "flow.3.mean",
        "flow.3.standard_deviation",
        "flow.4.mean",
        "load.1.force",
        "load.1.moment",
        "target.tip",
        "target.angle_deg",
    ]


def test_each_mistake_gives_its_line():
    lines = refused('arm = {length = -1, nodes = 2}\nwater.depht = 3\nload = [{kind = "push"}]')
    assert [line.split(":")[0] for line in lines] == [
        "arm.length",
        "arm.nodes",
        "water.depht",
        "load.0.kind",
    ]


def test_a_mistake_common_to_all_cases_is_told_once():
    (line,) = refused('vary = {"arm.lenght" = [1.0, 1.0, 1.0]}')
    assert line.endswith("arm.lenght: unknown key; did you mean arm.length?")


def test_broken_toml_names_file_line_and_column(tmp_path):
    path = tmp_path / "broken.toml"
    path.write_text("[arm]\nlength = 0..5\n")
    with pytest.raises(ScenarioError) as caught:
        load(path)
    (line,) = caught.value.lines
    assert line.startswith(f"{path}: not valid TOML: ")
    assert "line 2, column 11" in line


def test_toml_that_just_stops_names_line_and_column():
    (line,) = refused("[arm]\nradius = [0.1,")
    assert "line 2, column 15" in line


def test_missing_file(tmp_path):
    path = tmp_path / "nothing.toml"
    with pytest.raises(ScenarioError) as caught:
        load(path)
    (line,) = caught.value.lines
    assert line.startswith(f"{path}: no such file or built-in scenario")


def test_folder_and_binary_are_refused(tmp_path):
    binary = tmp_path / "binary.toml"
    binary.write_bytes(b"title = '\xff'")
    for path, reason in ((tmp_path, "is a folder, takes a TOML file"), (binary, "byte 9")):
        with pytest.raises(ScenarioError) as caught:
            load(path)
        (line,) = caught.value.lines
        assert line.startswith(f"{path}: ")
        assert reason in line


def test_mistakes_in_python_are_told_the_same_way():
    with pytest.raises(ScenarioError) as caught:
        Scenario(arm={"length": -1.0})
    assert caught.value.lines == ["arm.length: got -1.0, takes a number above 0 (m)"]
    with pytest.raises(ScenarioError) as caught:
        Arm(length=-1.0)
    assert str(caught.value) == "length: got -1.0, takes a number above 0 (m)"
    with pytest.raises(ScenarioError) as caught:
        Scenario(flow=[TipLoad(moment=1.0)])
    assert caught.value.lines[0].startswith('flow.0.kind: got "tip", takes "gauss-markov"')


def test_error_survives_pickling():
    with pytest.raises(ScenarioError) as caught:
        Scenario(seed=-1)
    assert pickle.loads(pickle.dumps(caught.value)).lines == caught.value.lines


def test_toml_round_trip_is_exact():
    scenario = Scenario.from_toml(FULL)
    text = scenario.to_toml()
    assert Scenario.from_toml(text) == scenario
    assert Scenario.from_toml(text).to_toml() == text
    assert tomllib.loads(text)["control"]["pid"]["tilt"]["ki"] == 0.1 + 0.2


def test_python_values_round_trip():
    scenario = Scenario(
        arm=Arm(radius=(0.02, 0.01)),
        base=Base(motion=[TableMotion(channel="slide", time=np.arange(3.0), value=np.zeros(3))]),
        load=[DistributedLoad(direction=(0, -1), magnitude=1)],
        flow=(UniformFlow(velocity=np.array([0.1, 0.0])),),
        simulation=Simulation(duration=2.0),
        vary={"flow.0.velocity": [np.array([0.1, 0.0]), (0.2, 0)]},
    )
    assert scenario.flow[0].velocity == (0.1, 0.0)
    assert scenario.base.motion[0].time == (0.0, 1.0, 2.0)
    assert Scenario.from_toml(scenario.to_toml()) == scenario


def test_default_scenario_is_valid_and_says_everything():
    scenario = Scenario()
    document = tomllib.loads(scenario.to_toml())
    assert Scenario.from_dict(document) == scenario == Scenario.from_toml("")
    assert document["arm"]["length"] == 0.5
    assert document["simulation"]["max_halvings"] == 12


def test_a_scenario_cannot_be_changed():
    scenario = Scenario()
    with pytest.raises(ValueError, match="frozen"):
        scenario.arm.length = 1.0
    assert scenario.arm.length == 0.5


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "full.toml"
    path.write_text(FULL)
    return path


def test_overrides(path):
    scenario = load(
        path,
        [
            "arm.length = 0.7",
            "load.0.magnitude=0.5",
            "load.0.direction=normal",
            "flow.1.velocity.0=1",
            "control.kind=none",
            "title=no quotes, please",
            "base.channels.slide.max_speed=1.5",
            'vary."load.0.direction"=["tangential"]',
        ],
    )
    assert scenario.arm.length == 0.7
    assert scenario.load[0] == DistributedLoad(direction="normal", magnitude=0.5)
    assert scenario.flow[1].velocity == (1.0, 0.1)
    assert scenario.control.kind == "none"
    assert scenario.title == "no quotes, please"
    assert scenario.base.channels.slide.max_speed == 1.5
    assert len(scenario.cases()) == 2


def test_overrides_make_what_is_missing(path):
    path.write_text("")
    scenario = load(path, ["flow.0.kind=uniform", "flow.0.velocity=[1, 0]", "arm.section.EA=10"])
    assert scenario.flow == (UniformFlow(velocity=(1.0, 0.0)),)
    assert scenario.arm.section.EA == 10.0


@pytest.mark.parametrize(
    ("setting", "line"),
    [
        ("arm.lenght=1", "arm.lenght: unknown key; did you mean arm.length?"),
        ("arm.length=0.5m", 'arm.length: got "0.5m", takes a number above 0 (m)'),
        ("arm.length", 'got "arm.length", takes key=value, such as arm.length=0.6'),
        ("arm..length=1", "arm..length: not a key; takes names joined by dots, such as arm.length"),
        ("arm.length.m=1", "arm.length.m: unknown key, arm.length is 0.6 and not a table"),
        (
            "load.9.magnitude=1",
            "load.9.magnitude: unknown key, load takes an index from 0 to 2 (2 adds one)",
        ),
    ],
)
def test_wrong_override_gives_one_line(path, setting, line):
    with pytest.raises(ScenarioError) as caught:
        load(path, [setting, "vary={}"])
    assert caught.value.lines == [line]


def test_cases_are_every_combination():
    scenario = Scenario.from_toml(FULL)
    cases = scenario.cases()
    expected = list(itertools.product([0.25, 1], ["normal", [0.0, -1.0]]))
    assert [tuple(values.values()) for values, _ in cases] == expected
    for values, case in cases:
        assert case.load[0].magnitude == values["load.0.magnitude"]
        assert case.load[0].direction in ("normal", (0.0, -1.0))
        assert case.vary == {}
        assert case.arm == scenario.arm
        assert case.cases() == [({}, case)]


def test_cases_may_vary_a_whole_table_or_an_integrator():
    scenario = Scenario(
        vary={
            "load": [[], [{"kind": "tip", "moment": 1.0}]],
            "simulation.integrator": ["newmark", "implicit-euler", "generalized-alpha"],
        }
    )
    cases = [case for _, case in scenario.cases()]
    assert [len(case.load) for case in cases] == [0, 0, 0, 1, 1, 1]
    assert [case.simulation.integrator_options for case in cases[:3]] == [
        {"beta": 0.25, "gamma": 0.5},
        {},
        {"spectral_radius": 0.8},
    ]


def test_rates_and_interval_follow_the_time_step():
    fine, coarse = (
        Scenario(simulation={"time_step": step, "duration": 1.0}) for step in (0.004, 0.05)
    )
    assert (fine.sensor_rate_hz, fine.control_rate_hz) == (100.0, 100.0)
    assert (coarse.sensor_rate_hz, coarse.control_rate_hz) == (20.0, 20.0)
    assert (fine.output_steps, coarse.output_steps) == (5, 1)
    assert math.isclose(fine.output_interval, 0.02)
    assert fine.simulation.steps == 250


def test_rate_of_once_a_time_step_passes_in_spite_of_rounding():
    step = 1 / 3 * 0.01
    scenario = Scenario(
        simulation={"time_step": step, "duration": 300 * step}, control={"rate_hz": 300.0}
    )
    assert scenario.control_rate_hz * step == pytest.approx(1.0)


def test_conveniences_are_in_si_units():
    scenario = Scenario.from_toml(FULL)
    limits = scenario.base.channels.present["tilt"].limits
    assert limits.high == pytest.approx(math.pi / 4)
    assert limits.speed == pytest.approx(math.pi / 2)
    assert list(scenario.base.channels.present) == ["slide", "heave", "tilt"]
    assert scenario.base.motion[0].amplitude_si == pytest.approx(math.radians(3))
    assert scenario.base.motion[1].value_si == (0.0, 0.1, 0.0)
    assert scenario.arm.radius == (0.02, 0.01)
    assert scenario.flow[0].power_exponent is None
    assert scenario.target.tip_path == ((0.6, -5.0), (0.5, -5.1))
    assert scenario.target.angle_path_deg is None


def test_spatial_toml_round_trip_is_exact():
    scenario = Scenario.from_toml(SPATIAL)
    text = scenario.to_toml()
    assert Scenario.from_toml(text) == scenario
    assert Scenario.from_toml(text).to_toml() == text


def test_conveniences_of_a_spatial_arm_are_in_si_units():
    scenario = Scenario.from_toml(SPATIAL)
    assert scenario.arm.rest_curvature == (0.1, -0.2, 0.3)
    assert scenario.arm.section.EI == (0.02, 0.01)
    assert scenario.base.angles == pytest.approx((math.pi / 6, -math.pi / 2, math.pi / 4))
    assert list(scenario.base.channels.present) == ["slide", "sway", "pan", "roll"]
    assert scenario.base.channels.present["roll"].limits.high == pytest.approx(math.pi / 9)
    assert list(scenario.control.pid.present) == ["slide", "pan", "roll"]
    assert scenario.base.motion[0].amplitude_si == 0.1
    assert scenario.base.motion[1].value_si == pytest.approx((0.0, math.pi / 2))
    assert scenario.flow[3].velocity == ("u", "v", "w")
    assert scenario.target.tip_path == ((0.6, 0.0, -5.0), (0.5, 0.1, -5.1))
    assert scenario.target.direction_path == ((1.0, 0.0, 0.0), (0.0, 0.6, 0.8))
    assert scenario.target.steady_direction is None
    assert Target(direction=(0.0, 0.0, 2.0)).steady_direction == (0.0, 0.0, 1.0)
    assert Target().steady_direction is Target().direction_path is None


def test_obstacles_have_the_axes_of_the_arm():
    pole, floor = Scenario.from_toml(SPATIAL).obstacle
    assert pole.half_axis == pytest.approx((0.0, 600.0, 800.0))
    assert pole.out == floor.half_axis == (0.0, 0.0, 0.0)
    assert floor.out == (0.0, 0.0, 1.0)
    rod = Capsule(position=(0.0, 0.0), radius=0.1, axis=(3.0, 0.0, 4.0), length=2.0)
    assert rod.half_axis == pytest.approx((0.6, 0.8))
    assert rod.out == (0.0, 0.0)
    assert Plane(position=(0.0, 0.0), normal=(0.0, -2.0)).out == (0.0, -1.0)


def test_a_joint_in_space_feels_every_turn():
    turns = ("pan", "tilt", "roll")
    sine = {"kind": "sine", "amplitude_deg": 1.0, "frequency_hz": 1.0}
    scenario = Scenario(
        arm={"dimension": 3},
        base={
            "mount": "pinned",
            "channels": {turn: {} for turn in turns},
            "motion": [sine | {"channel": turn} for turn in turns],
        },
    )
    assert list(scenario.base.channels.present) == list(turns)


OPEN = """
load = [{kind = "tip", moment = 1.0}, {kind = "tip", force = [1.0, 0.0]}]
obstacle = [{kind = "sphere", position = [1.0, -10.0], radius = 0.1}]
flow = [{kind = "measured", file = "current.nc"}]
"""


def defaults(scenario: Scenario) -> tuple:
    """Return everything of a scenario whose default follows the dimension."""
    load, obstacle, flow = scenario.load, scenario.obstacle, scenario.flow
    return (
        scenario.base.position,
        scenario.control.controlled,
        load[0].force,
        load[1].moment,
        obstacle[0].velocity,
        flow[0].velocity,
    )


def test_defaults_follow_the_dimension():
    planar = Scenario.from_toml(OPEN)
    assert defaults(planar) == (
        (0.0, -10.0),
        ("x", "z"),
        (0.0, 0.0),
        0.0,
        (0.0, 0.0),
        ("u", "w"),
    )
    given = {
        "arm.dimension": 3,
        "load.0.moment": [0.0, -1.0, 0.0],
        "load.1.force": [1.0, 0.0, 0.0],
        "obstacle.0.position": [1.0, 0.0, -10.0],
    }
    spatial = planar.with_values(given)
    assert defaults(spatial) == (
        (0.0, 0.0, -10.0),
        ("x", "y", "z"),
        (0.0, 0.0, 0.0),
        (0.0, 0.0, 0.0),
        (0.0, 0.0, 0.0),
        ("u", "v", "w"),
    )
    # what was left out goes on following the dimension, but what was given or written does not
    longer = spatial.with_values({"arm.length": 0.7})
    back = {
        "arm.dimension": 2,
        "load.0.moment": 1.0,
        "load.1.force": [1.0, 0.0],
        "obstacle.0.position": [1.0, -10.0],
    }
    assert defaults(longer.with_values(back)) == defaults(planar)
    with pytest.raises(ScenarioError, match=r"base\.position: got \[0\.0, 0\.0, -10\.0\]"):
        Scenario.from_toml(longer.to_toml()).with_values(back)


def test_a_default_may_be_changed_in_part():
    assert Scenario().with_values({"base.position.1": -5.0}).base.position == (0.0, -5.0)
    spatial = Scenario(arm={"dimension": 3}).with_values({"base.position.1": -5.0})
    assert spatial.base.position == (0.0, -5.0, -10.0)


def test_the_dimension_may_be_set_and_varied(path):
    path.write_text("[base]\ntilt_deg = -45.0")
    spatial = load(path, ["arm.dimension=3", "base.pan_deg=10"])
    assert spatial.base.position == (0.0, 0.0, -10.0)
    assert spatial == Scenario.from_toml(spatial.to_toml())
    both = load(path, ["vary={'arm.dimension' = [2, 3]}"])
    assert Scenario.from_toml(both.to_toml()) == both
    for study in (both, Scenario.from_toml(both.to_toml())):
        cases = [case for _, case in study.cases()]
        assert [len(case.base.position) for case in cases] == [2, 3]
        assert cases == [Scenario.from_toml(case.to_toml()) for case in cases]


def test_a_table_may_be_used_in_both_dimensions():
    base = Base(tilt_deg=10.0)
    spatial = Scenario(arm=Arm(dimension=3), base=base)
    assert Scenario(base=spatial.base).base.position == (0.0, -10.0)
    assert (base.position, spatial.base.position) == ((0.0, -10.0), (0.0, 0.0, -10.0))


def test_keys_of_the_other_dimension_are_not_written():
    planar, spatial = Scenario().to_dict(), Scenario(arm={"dimension": 3}).to_dict()
    assert planar["base"].keys() == {"position", "tilt_deg", "mount"}
    assert spatial["base"].keys() == {"position", "tilt_deg", "pan_deg", "roll_deg", "mount"}
    assert planar["target"] == {"tip": "initial", "angle_deg": "initial", "frame": "world"}
    assert spatial["target"] == {"tip": "initial", "direction": "initial", "frame": "world"}


def test_channels_are_those_of_the_base():
    names, coordinates = (get_args(get_args(kind)[0]) for kind in (ChannelName, Coordinate))
    assert names == CHANNELS[3]
    assert tuple(Channels.model_fields) == tuple(Pid.model_fields) == CHANNELS[3]
    assert set(coordinates) == {*COORDINATES[2], *COORDINATES[3]}


def test_schema_describes_every_key():
    schema = json_schema()
    text = json.dumps(schema)
    tables = [schema, *schema["$defs"].values()]
    keys = [key for table in tables for key in table["properties"].items()]
    assert [name for name, key in keys if not key.get("description")] == []
    assert schema["$schema"].endswith("2020-12/schema")
    assert schema["$defs"]["Arm"]["properties"]["length"]["unit"] == "m"
    references = {part.split('"')[0] for part in text.split('"#/$defs/')[1:]}
    assert references == set(schema["$defs"])
    others = [table["additionalProperties"] for table in tables]
    # gains go by the names of inputs, which are the user's
    assert [each for each in others if each] == [{"$ref": "#/$defs/PidGains"}]


def test_built_in_scenarios_load():
    assert builtin_names()
    for name in builtin_names():
        scenario = load(name)
        document = parse(builtin_text(name))
        anchor(document, Path(library.__file__).parent / "library")
        assert scenario == Scenario.from_dict(document)
        assert scenario.title
        assert all(path.is_file() for path in builtin_files(name))


def test_unknown_built_in_scenario():
    near = f"{builtin_names()[0]}s"
    with pytest.raises(ScenarioError, match=f"did you mean {builtin_names()[0]}"):
        load(near)
    with pytest.raises(ScenarioError, match=r"^nowhere: no such built-in scenario"):
        builtin_text("nowhere")


@pytest.mark.parametrize("size", [5e-324, 1e-200, 1.0, 1e200, 1.7e308])
def test_a_unit_vector_has_a_length_of_one_however_long_the_vector_is(size):
    np.testing.assert_allclose(unit_vector((size, -size, size)), np.array([1, -1, 1]) / 3**0.5)


def test_opposite_directions_are_refused_however_long_they_are():
    time = {"time": [0.0, 1.0]}
    for size in (1e-200, 1e200):
        target = {"direction": [[size, 0.0, 0.0], [-size, 0.0, 0.0]], **time}
        with pytest.raises(ScenarioError, match=r"target.direction.1: got .*, the opposite of"):
            Scenario(arm={"dimension": 3}, target=target)
        target = {"direction": [[size, 0.0, 0.0], [0.0, size, 0.0]], **time}
        assert Scenario(arm={"dimension": 3}, target=target).target.direction_path[1] == (0, 1, 0)
