"""Values that items keep from substep to substep, for phases of the step: see `kernels.phase.Phase.keeps`."""

from typing import Any

import warp as wp

from balloon_warp.model.memory import Allocating, Room
from balloon_warp.model.model import Model
from balloon_warp.model.timeline import kept_values


def kept_arrays(model: Model, room: Room) -> dict[str, Any]:
    """Return arrays for the values that items keep, by name."""
    counts = {
        "particle": model.particle_count, "face": model.face_count, "triangle": model.triangle_count,
        "balloon": model.balloon_count, "sphere": model.sphere_count, "world": 1,
    }  # fmt: skip
    return {
        each.name: room.array((model.world_count, counts[each.item]), wp.float32 if each.type is float else each.type)
        for each in kept_values(model)
    }


def start_kept(model: Model, kept: dict[str, Any]) -> None:
    """Fill in the values that items keep at the start."""
    for each in kept_values(model):
        kept[each.name].fill_(each.start)


def go_on_keeping(model: Model, kept: dict[str, Any]) -> dict[str, Any]:
    """Return the values that a model's items keep from here on: as they are, or as at the start."""
    fresh = kept_arrays(model, Allocating(model.device))
    start_kept(model, fresh)
    return {name: kept.get(name, array) for name, array in fresh.items()}
