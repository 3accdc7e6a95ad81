"""A measure: how far ahead the tip came."""

import xarray as xr


def reach(run: xr.Dataset) -> float:
    """Largest distance of the tip ahead of the origin."""
    return float(run["tip_position"].sel(axis="x").max())


reach.units = "m"
