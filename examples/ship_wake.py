"""The wake of a launch that passes an arm: a map of the surface, and the surface at the arm.

    python examples/ship_wake.py [ship-wake.png]

The launch is that of the built-in scenario `ship-wake`. Prints the height of its waves at the arm.
"""

import sys

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np

import crinoid

SHOWN = 15.0
"""Time of the map (s)."""
SIZE = 60.0, 24.0
"""Length and half the breadth of the map (m)."""


def main(path: str = "ship-wake.png") -> None:
    """Draw both into one figure."""
    # the sum of plane waves is as wide as a run of this duration needs
    space = ["arm.dimension=3", "base.position=[0, 0, -0.5]", "simulation.duration=60"]
    scenario = crinoid.load("ship-wake", space)
    ship, gravity = scenario.flow[0], jnp.asarray(scenario.water.gravity)
    wake = ship.build(scenario, None).carried(jnp.zeros(3), gravity)
    surface = jax.jit(jax.vmap(wake.elevation, (0, None)))
    bow, side = ship.speed * (SHOWN - ship.time) + ship.length / 2, -ship.distance
    x = np.linspace(bow + 4 - SIZE[0], bow + 4, 480)
    y = np.linspace(side - SIZE[1], side + SIZE[1], 384)
    rows = [surface(jnp.stack([x, 0 * x + each, 0 * x], axis=1), SHOWN) for each in y]
    # the sum has a mirrored pattern ahead of the ship, which is no part of the wake
    behind = np.where(x < bow - ship.length / 2, np.asarray(rows), np.nan)
    times = np.linspace(0.0, 30.0, 1501)
    at_arm = np.asarray(jax.jit(jax.vmap(wake.elevation, (None, 0)))(jnp.zeros(3), times))
    print(f"from the lowest trough to the highest crest: {np.ptp(at_arm):.2f} m")

    figure, (above, below) = plt.subplots(
        2, figsize=(7.0, 7.2), height_ratios=(3, 1), layout="constrained"
    )
    drawn = above.pcolormesh(x, y, behind, cmap="RdBu_r", vmin=-0.12, vmax=0.12, rasterized=True)
    figure.colorbar(drawn, ax=above, label="elevation (m)", shrink=0.8)
    middle, half = bow - ship.length / 2, np.linspace(-1, 1, 41)
    for sign in (1, -1):
        far = middle - x[0]
        above.plot([middle, x[0]], [side, side + sign * far / 8**0.5], "k:", linewidth=1)
    above.fill_between(
        middle + half * ship.length / 2,
        side - ship.beam / 2 * (1 - half**2),
        side + ship.beam / 2 * (1 - half**2),
        color="black",
    )
    above.plot(0, 0, "k+", markersize=12)
    above.annotate("arm", (0, 0), (4, 4), textcoords="offset points")
    above.set(xlabel="x (m)", ylabel="y (m)", aspect="equal", xlim=x[[0, -1]], ylim=y[[0, -1]])
    below.plot(times, at_arm, color="#0072b2")
    arrival = ship.time + 8**0.5 * ship.distance / ship.speed
    for time, name in ((ship.time, "launch abreast"), (arrival, "edge of the wedge")):
        below.axvline(time, color="0.5", linewidth=1, linestyle=":")
        below.annotate(name, (time, 0.11), (3, 0), textcoords="offset points", va="top")
    below.set(xlabel="time (s)", ylabel="at the arm (m)", xlim=times[[0, -1]], ylim=(-0.13, 0.13))
    figure.savefig(path, dpi=110)
    print(f"wrote {path}")


if __name__ == "__main__":
    main(*sys.argv[1:])
