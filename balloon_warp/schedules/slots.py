"""The springs of each particle in as many slots as the particle with most of them has, for the `block` schedule."""

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.kernels.loops.slots import SlotTable
from balloon_warp.model import Model
from balloon_warp.schedules.banks import spread_over_banks
from balloon_warp.schedules.rings import Ring
from balloon_warp.schedules.spring_ends import SpringEnds


def kind_slots(ends: SpringEnds) -> tuple[int, int, int]:
    """Return the most springs of each kind at a particle."""
    structural, shear, flexion = ends.by_kind.max(axis=0).tolist()
    return structural, shear, flexion


def slot_table(model: Model, ends: SpringEnds, ring: Ring | None = None) -> Any:
    """Return the table; slots that are left over hold a spring of no stiffness from the particle to itself.

    Args:
        ring: in which structural and shear springs go around each particle, where that matters.
    """
    neighbors, scales, rest_lengths = (
        np.concatenate(parts)
        for parts in zip(
            *(_slots_of_kind(ends, kind, ring[kind] if ring and kind < 2 else None) for kind in range(3)), strict=True
        )
    )

    def array(values: NDArray, dtype: Any) -> Any:
        return wp.array(values, dtype=dtype, device=model.device)

    table = SlotTable()
    table.neighbors = array(neighbors, wp.int32)
    table.scales = array(scales, float)
    table.rest_lengths = array(rest_lengths, float)
    table.valences = array(ends.by_kind[:, 0], wp.int32)
    return table


def slot_pairs(table: Any) -> wp.array:
    """Return the neighbors of a table, by their bits, and its rest lengths, in one place, where all scales are 1.

    Array of wp.vec2 of shape (slot_count, particle_count).
    """
    neighbors, lengths = table.neighbors.numpy(), table.rest_lengths.numpy()
    pairs = np.stack([neighbors.astype(np.int32).view(np.float32), lengths], axis=-1)
    return wp.array(pairs, dtype=wp.vec2, device=table.neighbors.device)


def _slots_of_kind(ends: SpringEnds, kind: int, ring: NDArray[np.int64] | None) -> tuple[NDArray, NDArray, NDArray]:
    """Return the neighbors, scales and rest lengths, each of shape (slot_count, particle_count)."""
    counts = ends.by_kind[:, kind]
    shape = counts.max(), len(counts)
    of_kind = ends.kind == kind
    particle = ends.particle[of_kind]
    slot = np.arange(len(particle)) - np.repeat(np.cumsum(counts) - counts, counts)
    neighbors = np.repeat(np.arange(shape[1])[None], shape[0], axis=0)
    scales, rest_lengths = np.zeros(shape), np.zeros(shape)
    neighbors[slot, particle] = ends.neighbor[of_kind]
    scales[slot, particle] = ends.scale[of_kind]
    rest_lengths[slot, particle] = ends.rest_length[of_kind]
    order = spread_over_banks(neighbors) if ring is None else _in_ring(neighbors, ring)
    return (
        np.take_along_axis(neighbors, order, axis=0),
        np.take_along_axis(scales, order, axis=0),
        np.take_along_axis(rest_lengths, order, axis=0),
    )


def _in_ring(neighbors: NDArray[np.int64], ring: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the order of each particle's slots that follows the ring, shape (slot_count, particle_count).

    Neighbors that are not in the ring come last.
    """
    order = np.repeat(np.arange(len(neighbors))[:, None], neighbors.shape[1], axis=1)
    for particle, around in enumerate(ring.T):
        wanted = around[around >= 0]
        place = {neighbor: slot for slot, neighbor in enumerate(neighbors[: len(wanted), particle].tolist())}
        order[: len(wanted), particle] = [place[neighbor] for neighbor in wanted.tolist()]
    return order
