"""Places of particles' entries in tables, so that a warp loads them together."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from balloon_warp.kernels.tables import SLICE


@dataclass(frozen=True)
class Slices:
    """Places of particles' entries, in slices of 32 particles."""

    offsets: NDArray[np.int64]
    places: NDArray[np.int64]
    """Place of each entry, sorted by particle"""
    owners: NDArray[np.int64]
    """Particle of each place, padded ones included"""


def slices_of(particles: NDArray[np.int64], counts: NDArray[np.int64], step: int) -> Slices:
    """Return each particle's entries filled up to a multiple of the step, and to the most in its slice."""
    slot = np.arange(len(particles)) - np.repeat(np.cumsum(counts) - counts, counts)
    padded = np.zeros(-(-len(counts) // SLICE) * SLICE, dtype=np.int64)
    padded[: len(counts)] = -(-counts // step) * step
    widths = padded.reshape(-1, SLICE).max(axis=1)
    offsets = SLICE * np.cumsum(np.append(0, widths))
    widths[-1] += 1  # room to read ahead of the last
    in_slice = np.arange(SLICE * widths.sum()) % SLICE
    owners = np.minimum(np.repeat(np.arange(len(widths)), SLICE * widths) * SLICE + in_slice, len(counts) - 1)
    return Slices(offsets, offsets[particles // SLICE] + SLICE * slot + particles % SLICE, owners)
