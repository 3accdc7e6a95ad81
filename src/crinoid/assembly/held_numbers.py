"""Numbers of `crinoid.parameters` that do not act as a key does, and what each holds fixed."""

DERIVED = {
    "arm.relaxation[i]": "with arm.loss_factor: the branches that its value and band gave",
    "base.motion[i].table": "curve through points: coefficients, knots, and sums, its integrals",
    "water.drag_normal": 'with coefficients = "literature": a factor on that drag, 1',
    "water.added_mass_normal": 'with coefficients = "literature": that of the flows, position, '
    "depth and diameter of the scenario; it stays when these change",
    "water.vortices.angles": "phases at the start, drawn by the seed",
    "flow[i].phases": "phases, drawn by the seed, of waves also by phase_deg",
    "flow[i].frequencies": "of waves, drawn by the seed; those that a current stops become NaN",
    "flow[i].record": "drawn by the seed or read from a file: coefficients, knots, and sums, its "
    "integrals",
    "flow[i].met": "place at which a record is met; it stays when base.position changes",
    "flow[i].slowness": "of a record: its mean velocity, which stays when the record changes",
    "flow[i].depth": "water.depth, which each flow has for itself",
    "flow[i].bed": "minus water.depth, which each flow has for itself",
    "flow[i].reference_height": "water.depth, which each flow has for itself, less reference_depth",
    "obstacle.surfaces": "solid from a file, on a grid for the radius of the scenario's arm",
    "simulation.integrator": "coefficients of the method",
}
"""Numbers that follow from several keys or none, with where they come from.

A change of another number leaves them as they are. A name stands for all that is in it.
"""

STRUCTURE = {
    "arm.length": "with contact.self: the edges that can touch stay",
    "arm.radius": "with contact.self: the edges that can touch stay",
    "arm.section.diameter": "with contact.self: the edges that can touch stay",
    "base.angles": "with a hull: the edges that can touch it stay",
    "base.servo": "with a hull: the edges that can touch it stay",
    "flow[i].onset.ramp_time": "the resolution with which a ramp is integrated stays",
    "actuator[0].span": "the nodes that a thread passes stay: more than half an edge beyond the "
    "last of them a longer span adds nothing",
}
"""Numbers by which a scenario's keys also change the structure of the program, which is static."""
