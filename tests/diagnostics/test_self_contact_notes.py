"""Notes on an arm that pressed on itself."""

import xarray as xr

from crinoid.diagnostics.run_notes import _pressed_on_itself


def run(gap, pairs):
    """Return a result of two edges, 20 mm thick."""
    return xr.Dataset(
        {"self_gap": (("time", "edge"), [[gap, 1.0]]), "self_pairs": ("time", [pairs])},
        {"diameter": ("node", [0.02, 0.02, 0.02])},
    )


def test_only_what_the_contact_model_does_not_cover_is_noted():
    assert not _pressed_on_itself(xr.Dataset())
    assert not _pressed_on_itself(run(2e-4, 4))
    (pressed,) = _pressed_on_itself(run(-2e-4, 4))
    assert "penetrated itself by 0.2 mm" in pressed
    (crowded,) = _pressed_on_itself(run(2e-4, 5))
    assert "5 pairs" in crowded
    assert "nearest 4" in crowded
