"""Whether particles near obstacles leave these in a launch of their own, and the memory that this takes."""

from typing import Any

import warp as wp

from balloon_warp.kernels.traits import Traits
from balloon_warp.model import Model
from balloon_warp.model.memory import Room

MANY = 500_000
"""particles in all worlds, which take a GPU several times as long as one more launch"""
ENOUGH_THREADS = 262_144
"""that keep a GPU busy"""
FEW_THREADS = 64
"""of a block, where each thread takes many registers"""


def puts_off(model: Model, traits: Traits) -> bool:
    """Whether particles that may meet what goes where it is told are put off, see `kernels.schedules.later`. Not where
    spheres come first, nor where all wait for each other anyway."""
    waits = traits.leaves_at_once and not traits.penalties
    return traits.stands_on_fixtures and waits and has_many(model)


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


def later_arrays(model: Model, traits: Traits, room: Room) -> dict[str, Any]:
    """What of `Working` is for them."""
    worlds, particles, turns = (model.world_count, model.particle_count, 2) if puts_off(model, traits) else (0, 0, 0)
    return {
        "later": room.array((worlds, particles), wp.int32),
        "later_counts": room.array((worlds, turns), wp.int32),
    }
