"""Time of the quadratic program of a receding horizon, by its number of unknowns.

A chain of oscillators with drawn disturbances, limits on value, speed and acceleration of which a
third or more are active; the median over draws, on one core, alone and for each of 64 at once.
"""

import argparse
import json
import time
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from rich.console import Console
from rich.table import Table

from crinoid.control.qp import HorizonQp

HERE = Path(__file__).parent
SIZES = [(2, 15), (2, 30), (4, 15), (4, 30), (4, 60)]
TOGETHER = 64


def problem(inputs, moves, draw):
    """Return a program, and its arguments."""
    delay = np.subtract.outer(np.arange(moves), np.arange(moves))
    response = np.zeros((moves, 2, inputs, moves))
    for output in range(2):
        for each in range(inputs):
            turn, shrink = draw.uniform(0.1, 0.8), draw.uniform(0.8, 0.97)
            step = np.cumsum(shrink ** np.arange(moves) * np.cos(turn * np.arange(moves)))
            response[:, output, each] = draw.normal() * np.where(delay >= 0, step[delay], 0.0)
    flat = response.reshape(2 * moves, -1)
    squares = flat.T @ flat
    hessian = squares + 0.01 * np.trace(squares) / len(squares) * np.eye(len(squares))
    error = draw.normal(size=(moves, 2)).cumsum(axis=0).ravel()
    gradient = -(flat.T @ error).reshape(inputs, moves)
    free = np.linalg.solve(hessian, -gradient.ravel()).reshape(inputs, moves)
    rate = 0.5 * np.abs(free).max(axis=1)
    limit = 0.5 * np.abs(free.cumsum(axis=1)).max(axis=1)
    shaped = hessian.reshape(inputs, moves, inputs, moves)
    program = HorizonQp.of(shaped, rate=rate, acceleration=0.3 * rate, lengths=np.ones(moves))
    zero = np.zeros(inputs)
    return program, tuple(jnp.asarray(each) for each in (gradient, -limit, limit, zero, zero))


def solve(program, gradient, lower, upper, last, moving):
    return program.solve(gradient, lower=lower, upper=upper, last=last, moving=moving)


def timed(run, given, repeats):
    """Return the median time of a call, and what came out."""
    found = jax.block_until_ready(run(*given))
    spent = []
    for _ in range(repeats):
        begun = time.perf_counter()
        jax.block_until_ready(run(*given))
        spent.append(time.perf_counter() - begun)
    return float(np.median(spent)), found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=20)
    options = parser.parse_args()
    table = Table(title="Receding horizon, one solution", title_justify="left")
    for column in ("inputs", "moves", "unknowns", "alone (ms)", f"each of {TOGETHER} (ms)"):
        table.add_column(column, justify="right")
    table.add_column("optimal", justify="right")
    rows = []
    one, many = eqx.filter_jit(solve), eqx.filter_jit(jax.vmap(solve))
    for inputs, moves in SIZES:
        draw = np.random.default_rng(0)
        drawn = [problem(inputs, moves, draw) for _ in range(TOGETHER)]
        spent = [timed(one, (program, *given), options.repeats)[0] for program, given in drawn[:8]]
        stacked = jax.tree.map(lambda *each: jnp.stack(each), *drawn)
        together, found = timed(many, (stacked[0], *stacked[1]), 3)
        alone, share = float(np.median(spent)), float(np.mean(found.optimal))
        rows.append((inputs, moves, alone, together / TOGETHER, share))
        numbers = (f"{1e3 * alone:.2f}", f"{1e3 * together / TOGETHER:.2f}", f"{share:.0%}")
        table.add_row(str(inputs), str(moves), str(inputs * moves), *numbers)
    Console(highlight=False).print(table)
    results = HERE / "results"
    results.mkdir(exist_ok=True)
    (results / "mpc.json").write_text(json.dumps(rows, indent=2), "utf-8")


if __name__ == "__main__":
    main()
