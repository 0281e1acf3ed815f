"""Memory that launches of a step's pieces share: values between pieces, and what contact keeps beside the state."""

from typing import Any

import warp as wp

from balloon_warp.kernels.contact.near import mark_count
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.phase import Item
from balloon_warp.kernels.schedules.launched.few import asked_ahead
from balloon_warp.kernels.schedules.launched.source import ITEMS_OF_PART
from balloon_warp.kernels.schedules.pieces import Step, values_of
from balloon_warp.model import Model
from balloon_warp.model.memory import Room
from balloon_warp.model.state import contact_shape
from balloon_warp.schedules.balloon_contact import touch_arrays
from balloon_warp.schedules.ridges import ridge_arrays
from balloon_warp.schedules.solids import solid_arrays

LARGE = 2048
"""Number of particles of a balloon above which it is summed in parts"""


def step_arrays(model: Model, step: Step, room: Room) -> tuple[dict[str, Any], dict[str, Any], dict[str, Any]]:
    """Allocate values that live from one piece to another, parts of sums, and second places of particles' state."""
    worlds = model.world_count
    counts = {"particle": model.particle_count, "face": model.face_count, "balloon": model.balloon_count}
    values = {
        value: room.array((worlds, counts[step.owner(value)]), wp.float32 if dtype is float else dtype)
        for value, dtype in values_of(step).items()
    }
    if any(asked_ahead(step, piece) for piece in step.pieces):
        values["acting"] = room.array((worlds, -(-model.particle_count // 4) * 4), wp.int8)
    parts = {}
    for piece in step.pieces:
        if piece.sums and (count := _part_count(model, piece.item)):
            assert piece.summing
            (dtype,) = piece.summing.writes.values()
            shape = (worlds, model.balloon_count, count)
            parts[piece.name] = room.array(shape, wp.float32 if dtype is float else dtype)
    second = {name: room.array((worlds, model.particle_count), wp.vec3) for name in step.doubled}
    return values, parts, second


def wide_arrays(model: Model, step: Step, room: Room) -> list[Any]:
    """Allocate the points in sixteen bytes: of the state, and of their second place."""
    places = (1 + ("point" in step.doubled)) if step.wide else 0
    return [room.array((model.world_count, model.particle_count), wp.vec4) for _ in range(places)]


def _part_count(model: Model, item: Item) -> int:
    """Count the parts in which the items of a balloon are added up; 0 where it is done in one go."""
    counts = [mesh.face_count if item == "face" else len(mesh.points) for mesh in (s.mesh for s in model.shapes)]
    largest = max(counts)
    return -(-largest // int(ITEMS_OF_PART)) if largest > LARGE else 0


def working_arrays(model: Model, features: Features, room: Room) -> dict[str, Any]:
    """Allocate what contact keeps beside the state; empty where a scene does not need it."""
    worlds = model.world_count
    return {
        "gas_masses": room.array((worlds, model.balloon_count if features.gas else 0), wp.float32),
        "sphere_quanta": room.array((worlds, model.sphere_count if features.penalties else 0, 3), wp.int64),
        **solid_arrays(model, features, room),
        **ridge_arrays(model, features, room),
        "contact_impulses": room.array(contact_shape(model), wp.vec4),
        **touch_arrays(model, features, room),
        **verdict_arrays(model, features, room),
        "near": room.array((worlds, mark_count(model.particle_count) if features.impulses else 0), wp.int32),
    }


def verdict_arrays(model: Model, features: Features, room: Room) -> dict[str, Any]:
    """Allocate what is known of each world's frame as it begins; empty where nothing is asked."""
    asked = features.frames != "all"
    return {
        "ways": room.array(model.world_count if asked else 0, wp.float32),
        "verdicts": room.array(model.world_count if asked else 0, wp.int32),
        "any_busy": room.array(1 if asked else 0, wp.int32),
    }
