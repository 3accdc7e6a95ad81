"""Fixed numbers of the physics and its solvers, which no scenario sets.

A number without a unit is a ratio. They are in one place so that a reader can judge and cite them;
a plug-in may import them, and not change them.
"""

# --- Contact with obstacles and itself ------------------------------------------------------------

SKIN = 0.05
"""Thickness of the soft skin of the arm, over its radius.

It says that a body holds the arm off, and not how the flesh is dented.
"""
SKIN_STRENGTH = 32.0
"""Force where the surfaces meet, over the modulus and the squared radius of the arm.

So large that a gap does not close in ordinary use.
"""
SKIN_DAMPING = 0.2
"""Damping ratio of the skin of a rough surface: a hit returns about half of its speed.

Without it the skin chatters under a limp arm that slides.
"""
EASE = 0.01
"""Weight that draws the point of contact to the middle of an edge.

Without it that point, and the force, jump from end to end of an edge that lies along a surface.
"""
CREEP = 1e-3
"""Sliding speed at which friction is fully developed (m/s).

It makes Coulomb's law smooth; a body that should stick creeps by less.
"""
MISSED_WORK = 0.01
"""Largest error of a step in the work of a contact, over the energy of the hit.

A step that exceeds it is halved.
"""
NEGLIGIBLE_WORK = 5e-7
"""Negligible error in that work, over the energy of the fully compressed skin."""
NEAREST_STEPS = 12
"""Steps of the search for the nearest point of a surface along an edge.

Each halves the bracket at least once every two.
"""
BED_RANGE = 2.0
"""Distance within which the one of a bed is of second order, over the radius of the arm."""
CANDIDATES = 2
"""Number of pairs of far edges that may press at the same time, for each edge."""

# --- Free bodies ----------------------------------------------------------------------------------

BODY_SKIN = 0.02
"""Thickness of the skin between two bodies, over the smaller radius."""
SKIN_WEIGHTS = 100.0
"""Force at the end of that skin, over the weight of the lighter body, in addition to the arm's."""
SPHERE_DRAG = 0.47
"""Drag coefficient of a sphere between Reynolds numbers of 1e3 and 1e5 (Hoerner 1965, 3-8)."""
CROSS_FLOW_DRAG = 1.1
"""Drag coefficient of a cylinder across its axis (Hoerner 1965, 3-9)."""

# --- Tendons and chambers -------------------------------------------------------------------------

ADHESION = 2e-4
"""Sliding ``x_0`` over the length of a thread, after which its friction has nearly developed."""
EVEN = 1e-9
"""Angle (rad), and sliding over ``x_0``, below which an absolute value is smooth."""
TOE = 1e-4
"""Strain over which a tendon grows taut, like the toe of real tendons.

Newton's method can follow the slope.
"""

# --- Material -------------------------------------------------------------------------------------

BRANCH_FITS = 5
"""Fits of Maxwell branches to a loss factor; by then the weights settle."""

# --- Shed vortices --------------------------------------------------------------------------------

AVERAGED_PERIODS = 5.0
"""Shedding periods over which ``Synchronisation`` averages flow and motion of the arm."""
STILL_SPEED = 1e-3
"""Speed of the arm over that of the water below which it counts as still.

That is an amplitude of 0.001 D.
"""
FIRST_WAKE = 0.1
"""Largest wake variable at the start."""

# --- Waves and turbulence -------------------------------------------------------------------------

DEEP_WATER = 100
"""Depth of deep water, over the wavelength."""
SPECTRUM_LOWEST = 0.5
"""Lower limit of a spectrum of waves over its peak frequency.

99.5 % of it lie between both limits.
"""
SPECTRUM_HIGHEST = 4.0
"""Upper limit of the spectrum over its peak frequency."""
WAVE_NUMBER_STEPS = 100
"""Largest number of Newton's steps to a wave number."""
POINTS_PER_CORRELATION_TIME = 20
"""Sampling of a Gauss-Markov process: the spline through the points has 99.6 % of its variance."""
SPLINE_POINTS = 40
"""Points before and after its record, so that the ends of the spline do not affect it."""
WAVE_NUMBER_CHANGE = 1e-14
"""Relative step at which a wave number is found."""

# --- Newton's method in a time step ---------------------------------------------------------------

ROUNDING = 4.0
"""Floor of a row of the residual, over the effect on it of relative errors eps.

Eight times the largest round-off of a number, eps / 2, because elements round as well. Inertia
counts as if it followed from positions, which matters in steps below 0.1 ms.
"""
NOISE = 1 / 4
"""Share of the floor down to which iterations go on.

The residual of an arm at rest is within it: below it there is nothing to gain.
"""
CHORD_MARGIN = 4.0
"""Safety factor on the expected success of an iteration with an old tangent."""
AGED_CONTRACTION = 1e-3
"""Least contraction assumed for the tangent of an earlier step.

That of a new tangent may be far less, which says nothing about the next step.
"""
STALLED = 0.5
"""Contraction above which an iteration makes no progress."""
JERKY = 1.0
"""Threshold of a jerky base: squared changes of its acceleration over squared accelerations.

It is 1.5 for noise, 3 for a sign that alternates from step to step, 0.1 for resolved motion.
"""
ERROR_GROWTH = 8.0
"""Growth of the local error of a method of order 2 when a step is doubled."""
KNOWN_ROUND_OFF = 0.01
"""Largest round-off of forces that goes unreported, over the largest force on the base."""
UNSEEN_BEND = 1e-6
"""Largest force that bends an arm imperceptibly, over EI / L^2."""

# --- Equilibria -----------------------------------------------------------------------------------

FIRST_SHARE = 0.25
"""Share of the loads in the first solve."""
SMALLEST_SHARE = 1e-3
"""Share below which all remaining loads are applied, for the relaxation to balance."""
NEARER = 0.9
"""Largest share of the imbalance after an accepted solve, in the water at the new place."""
SHIFT_FALL = 0.5
"""Factor on the resistance from one solve to the next while the arm comes to rest."""
SHIFT_RISE = 4.0
"""Factor on the resistance after a rejected solve."""
KICK = 1e-3
"""Lateral push that tests an equilibrium, and least progress of a solve, over the length."""
NO_MOVEMENT = 1e-9
"""Negligible movement, over the arm's length."""
LEAVING = 1.2
"""Growth of the movement at the same resistance that shows divergence."""
MAX_SOLVES = 400
"""Largest number of solves for the arm to come to rest."""
LAST_SOLVES = 20
"""Further solves from the shape that first bore all loads."""
TOLERANCE_SHARE = 1e-3
"""Tolerance over that of a time step."""
FRICTION_ROUNDS = 16
"""Number of solves with friction of tendons.

A fixed one, so that both modes of differentiation apply.
"""
FRICTION_SETTLED = 1e-7
"""Largest displacement of the last of them, over the arm's length."""
LOAD_STEPS = 8
"""Number of steps on the way to other loads, and then at them."""

# --- Damped modes ---------------------------------------------------------------------------------

DENSE_UNKNOWNS = 400
"""Number of unknowns up to which the problem is solved in dense matrices."""
SPARE_MODES = 40
"""Undamped modes that span a larger problem, in addition to two for each mode requested."""
NEGLIGIBLE_PART = 1e-7
"""Relative size of a negligible part of an eigenvalue: a double root has half the digits."""
UNDAMPED = 1e-10
"""Relative size of a real part that is round-off."""
REFINED = 1e-9
"""Relative change of an eigenvalue at which its refinement ends."""
SETTLED_RATE = 1e-8
"""Relative change of the rate of a mode of a relaxing material at which it has settled."""
RATE_SOLVES = 30
"""Largest number of solves of either."""
