"""The version of crinoid, and those of packages that a result may depend on."""

import platform
from importlib.metadata import PackageNotFoundError, version

__version__ = "0.2.0"

_MATTER = ("jax", "jaxlib", "equinox", "numpy", "scipy", "xarray", "netCDF4", "pydantic")


def version_of(package: str) -> str:
    """Return the version of a package, empty if it is not installed."""
    try:
        return version(package)
    except PackageNotFoundError:
        return ""


def versions() -> dict[str, str]:
    """Return the versions that matter by name; that of crinoid first."""
    ours = {"crinoid": __version__, "Python": platform.python_version()}
    return ours | {name: version_of(name) for name in _MATTER}
