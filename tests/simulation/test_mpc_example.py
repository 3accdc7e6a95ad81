"""The model predictive controller of the examples holds the tip through a session."""

import numpy as np
import pytest

from helpers.paths import ROOT
from helpers.scripts import load_script

pytest.importorskip("control")
EXAMPLE = ROOT / "examples" / "mpc_in_the_loop.py"


@pytest.mark.release
def test_a_controller_of_python_control_closes_the_loop_in_eighty_lines():
    assert len(EXAMPLE.read_text("utf-8").splitlines()) <= 80
    result = load_script(EXAMPLE).run(6.0)
    assert result.status == "ok"
    error = result.dataset["tip_error"].sel(time=slice(3.0, None)).values
    assert np.sqrt(np.mean(error**2)) < 4e-3
    command = result.dataset["base_command"].values
    assert np.unique(command[:, 0]).size > 100  # once a period of 0.05 s
