"""Sums over balloons, by a block each: its threads, and the parts of large ones."""

from balloon_warp.kernels.phase import Item
from balloon_warp.kernels.schedules.launched.source import ITEMS_OF_PART
from balloon_warp.model import Model

TEAM_THREADS = 256
"""Threads of a block for phases of a world and for sums, on a GPU; more would have too few registers"""
TEAM_THREADS_OF_SMALL, SMALL = 64, 1024
"""Threads where no balloon has more particles: more blocks then run at once, while one thread of each ends its sum"""
LARGE = 2048
"""Number of particles of a balloon above which it is summed in parts"""


def team_threads(model: Model) -> int:
    """Return how many threads add up a balloon, or a part of it; on a CPU one.

    It does not depend on the number of worlds, which would change the order of a world's sums.
    """
    if not model.device.is_cuda:
        return 1
    return TEAM_THREADS_OF_SMALL if _largest_balloon(model) <= SMALL else TEAM_THREADS


def _largest_balloon(model: Model) -> int:
    """Return the number of particles of the largest balloon."""
    return max((len(shape.mesh.points) for shape in model.shapes), default=0)


def part_count(model: Model, item: Item) -> int:
    """Count the parts in which the items of a balloon are added up; 0 where it is done in one go."""
    counts = [mesh.face_count if item == "face" else len(mesh.points) for mesh in (s.mesh for s in model.shapes)]
    return -(-max(counts) // int(ITEMS_OF_PART)) if max(counts) > LARGE else 0


def sums_in_parts(model: Model) -> bool:
    """Return whether a balloon has so many particles that it is summed in parts."""
    return _largest_balloon(model) > LARGE
