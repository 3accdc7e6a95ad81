"""A batch over all cores: import this before JAX computes anything."""

import os
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
from jax.sharding import AxisType, PartitionSpec

from crinoid.simulation.batch import cores

CORES = cores()
# as many devices as cores, for a batch to be split over
os.environ["XLA_FLAGS"] = (
    f"{os.environ.get('XLA_FLAGS', '')} --xla_force_host_platform_device_count={CORES}"
)


def over_cores(function: Callable[..., Any], fixed: tuple[Any, ...], batch: jax.Array) -> Any:
    """Return ``function(*fixed, batch)``, of which each core does its part of the batch."""
    arrays, rest = eqx.partition(fixed, eqx.is_array)

    def part(arrays: Any, batch: jax.Array) -> Any:
        return function(*eqx.combine(arrays, rest), batch)

    mesh = jax.make_mesh((CORES,), ("arms",), axis_types=(AxisType.Auto,))
    spread = PartitionSpec("arms")
    split = jax.shard_map(
        part,
        mesh=mesh,
        in_specs=(PartitionSpec(), spread),
        out_specs=spread,
        check_vma=False,
    )
    return split(arrays, batch)
