"""Particles that touch, or are near obstacles: whether they end a substep in a launch of their own, and by how many
threads."""

from balloon_warp.model import Model

MANY = 500_000
"""particles in all worlds, which take a GPU several times as long as one more launch"""
ENOUGH_THREADS = 262_144
"""that keep a GPU busy"""
FEW_THREADS = 64
"""of a block, where each thread takes many registers"""


def has_many(model: Model) -> bool:
    """Whether a GPU takes much longer for all particles than for a launch."""
    return model.device.is_cuda and model.world_count * model.particle_count >= MANY


def threads_of_list(model: Model) -> int:
    """Threads that go through a list of a world's particles: on a GPU whole blocks, for an eighth of all, or for all
    where worlds are few."""
    if not model.device.is_cuda:
        return 1
    wanted = max(model.particle_count // 8, min(ENOUGH_THREADS // model.world_count, model.particle_count))
    return -(-wanted // FEW_THREADS) * FEW_THREADS
