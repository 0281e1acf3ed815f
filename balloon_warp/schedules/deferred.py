"""Deferred contacts: whether touching particles end a substep in a launch of their own, and its threads."""

from balloon_warp.model import Model

MANY = 500_000
"""Number of particles in all worlds above which they take a GPU several times as long as one more launch"""
ENOUGH_THREADS = 262_144
"""Number of threads that keep a GPU busy"""
MOST_AT_ONCE = 65_536
"""Number of threads that a GPU has at once, where each takes many registers, or more"""
FEW_THREADS = 64
"""Threads of a block, where each takes many registers"""


def has_many(model: Model) -> bool:
    """Return whether a GPU takes much longer for all particles than for a launch."""
    return model.device.is_cuda and model.world_count * model.particle_count >= MANY


def threads_of_list(model: Model) -> int:
    """Return the number of threads that loop over a list of a world's particles.

    On a GPU whole blocks, for an eighth of all, or for all where worlds are few.
    """
    if not model.device.is_cuda:
        return 1
    wanted = max(model.particle_count // 8, min(ENOUGH_THREADS // model.world_count, model.particle_count))
    return -(-wanted // FEW_THREADS) * FEW_THREADS
