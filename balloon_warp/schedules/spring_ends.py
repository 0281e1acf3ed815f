"""The springs of a model as its particles see them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from balloon_warp.model import Model


@dataclass(frozen=True)
class SpringEnds:
    """Every spring twice, from each of its ends, sorted by particle, kind and neighbor."""

    particle: NDArray[np.int64]
    neighbor: NDArray[np.int64]
    kind: NDArray[np.int64]
    scale: NDArray[np.float64]
    """Spring constant over that of its kind"""
    rest_length: NDArray[np.float64]
    """Rest length [m]"""
    by_kind: NDArray[np.int64]
    """Number of springs of each kind at each particle, shape (particle_count, 3)"""


def spring_ends(model: Model) -> SpringEnds:
    """Return the model's springs as its particles see them."""
    ends = model.spring_particles.numpy().astype(np.int64).reshape(-1, 2)
    kind = np.tile(model.spring_kind.numpy().astype(np.int64), 2)
    particle, neighbor = np.concatenate([ends, ends[:, ::-1]]).T
    count = model.particle_count
    order = np.argsort(count * (3 * particle + kind) + neighbor, kind="stable")
    return SpringEnds(
        particle=particle[order],
        neighbor=neighbor[order],
        kind=kind[order],
        scale=np.tile(np.asarray(model.spring_stiffness_scale.numpy(), dtype=np.float64), 2)[order],
        rest_length=np.tile(np.asarray(model.spring_rest_length.numpy(), dtype=np.float64), 2)[order],
        by_kind=np.bincount(3 * particle + kind, minlength=3 * count).reshape(count, 3),
    )


def neighbors_in_slots(ends: SpringEnds, kind: int) -> NDArray[np.int64]:
    """Return the particles at the other ends of each particle's springs of a kind, shape (slot_count, particle_count).

    -1 marks an empty slot.
    """
    counts = ends.by_kind[:, kind]
    of_kind = ends.kind == kind
    particle = ends.particle[of_kind]
    neighbors = np.full((counts.max(), len(counts)), -1)
    neighbors[np.arange(len(particle)) - np.repeat(np.cumsum(counts) - counts, counts), particle] = ends.neighbor[
        of_kind
    ]
    return neighbors
