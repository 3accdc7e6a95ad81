"""A model predictive controller of your own holds the tip of an arm through a session.

    pip install "crinoid[control]"
    python examples/mpc_in_the_loop.py

The model is crinoid's linear one, as a state space of python-control, reduced to 12 states. A
Kalman filter of python-control estimates these and a steady current from the readings of the tip.
Bounded least squares finds the commands of the next second that keep the tip at its target.
"""

import numpy as np
from scipy.optimize import lsq_linear

import control
import crinoid

ORDER, HORIZON = 12, 20
TIP, WATER = ["x", "angle"], ["current_x"]


class PredictiveController:
    """Commands for the next periods that minimise errors of the tip and changes of commands."""

    def __init__(self, model, inputs):
        inputs = [each for each in inputs if f"command_{each.name}" in model.inputs]
        self.names = [each.name for each in inputs]
        plant = model.reduced(ORDER).to_control()
        column, row = plant.input_labels.index, plant.output_labels.index
        driven, stirred = [column(f"command_{n}") for n in self.names], [column(w) for w in WATER]
        read, tip = ([row(f"{of}_{n}") for n in TIP] for of in ("measured_tip", "tip"))
        self.rest = model.operating_outputs[read]
        # the current is a state that stays as it is
        waters, zero = len(stirred), np.zeros((len(stirred), ORDER))
        self.A = np.block([[plant.A, plant.B[:, stirred]], [zero, np.eye(waters)]])
        self.B = np.vstack([plant.B[:, driven], np.zeros((waters, len(driven)))])
        self.C, wanted = (np.hstack([plant.C[k], plant.D[np.ix_(k, stirred)]]) for k in (read, tip))
        noise = np.diag([1e-6] * ORDER + [1e-3] * waters)
        self.gain, _, _ = control.dlqe(self.A, np.eye(len(self.A)), self.C, noise, 1e-6 * np.eye(2))
        # outputs of the horizon: free response of the state, and effect of each command
        powers = [np.linalg.matrix_power(self.A, k) for k in range(HORIZON + 1)]
        self.free = np.vstack([wanted @ power for power in powers[1:]])
        effect = [wanted @ power @ self.B for power in powers[:-1]]
        later, numbers = range(HORIZON), HORIZON * len(driven)
        blocks = [[effect[i - j] * (i >= j) for j in later] for i in later]
        changes = np.eye(numbers) - np.eye(numbers, k=-len(driven))
        self.weight = 0.1
        self.matrix = np.vstack([np.block(blocks), self.weight * changes])
        limits = [[float(getattr(each, end)) for each in inputs] for end in ("lower", "upper")]
        self.limits = np.tile(limits, HORIZON)
        self.state, self.last = np.zeros(len(self.A)), np.zeros(len(driven))

    def __call__(self, seen: crinoid.ControllerInput) -> dict[str, float]:
        """Return the commands for the next period by name."""
        measured = seen.measured[[0, -1]] - self.rest
        estimate = self.state + self.gain @ (measured - self.C @ self.state)
        wanted = np.tile(seen.reference[[0, -1]] - self.rest, HORIZON)
        first = np.zeros(HORIZON * self.last.size)
        first[: self.last.size] = self.weight * self.last
        target = np.concatenate([wanted - self.free @ estimate, first])
        self.last = lsq_linear(self.matrix, target, self.limits).x[: self.last.size]
        self.state = self.A @ estimate + self.B @ self.last
        return dict(zip(self.names, self.last, strict=True))


def run(duration: float = 10.0) -> crinoid.Result:
    """Return the result of a run in the current of a built-in scenario."""
    values = {"control.rate_hz": 20.0, "simulation.duration": duration}
    scenario = crinoid.load("station-keeping").with_values(values)
    session = crinoid.Session(scenario)
    controller = PredictiveController(crinoid.linearise(scenario), session.inputs)
    while not session.ended:
        session.step(controller(session.seen))
    return session.result()


if __name__ == "__main__":
    late = run().dataset["tip_error"].sel(time=slice(3.0, None)).values
    print(f"RMS tip error from 3 s on {1e3 * np.sqrt(np.mean(late**2)):.2f} mm")
