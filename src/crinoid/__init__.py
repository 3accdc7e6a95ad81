"""Simulate and control a soft robotic arm in moving water."""

import jax

# round-off of 32 bits would drown the stretch of a stiff arm
jax.config.update("jax_enable_x64", True)  # type: ignore[no-untyped-call]

from crinoid.version import __version__ as __version__  # noqa: E402
