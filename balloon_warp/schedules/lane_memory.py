"""The memory of worlds that are simulated eight lanes at a time, a row for each group of eight, or for each world."""

import os
from typing import Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.kernels.contact.near import mark_count
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.lanes import LANE_COUNT, Lanes, Lanes3
from balloon_warp.kernels.schedules.lanes.layouts import Layout
from balloon_warp.kernels.schedules.lanes.source import arguments_of, kinds_of
from balloon_warp.kernels.schedules.pieces import Step
from balloon_warp.model import Model
from balloon_warp.model.memory import Room
from balloon_warp.schedules.lane_tables import face_octets, items_of

LANES = int(LANE_COUNT)
FAR_AWAY = 1e16
"""Coordinate of a face that is nearest to no particle [m], whose square is a finite float"""


class LaneMemory(NamedTuple):
    """Arrays by name; those that a scene does not need are empty."""

    of_kernel: dict[str, Any]
    """State and values, as arguments of the kernel"""
    of_tables: dict[str, Any]
    solids: dict[str, Any]
    working: dict[str, Any]


def group_count(model: Model, layout: Layout) -> int:
    """Return the groups of worlds, or worlds."""
    return -(-model.world_count // LANES) if layout.worlds else model.world_count


def shares_of(model: Model, layout: Layout, thread_count: int | None = None) -> list[NDArray[np.int64]]:
    """Return the groups of each thread; a thread a core, if not given, and no more than there are groups."""
    groups = group_count(model, layout)
    return np.array_split(np.arange(groups), min(thread_count or os.cpu_count() or 1, groups))


def allot_lanes(model: Model, step: Step, layout: Layout, room: Room) -> LaneMemory:
    """Ask for it."""
    groups, items, features = group_count(model, layout), items_of(model, layout).count, step.features
    balloons, width = model.balloon_count, features.columns.width
    solids = model.sphere_count + (len(model.obstacles) if features.stands_on_fixtures else 0)
    adds_up = bool(features.membranes) or features.has("hinge") or features.has("face")
    return LaneMemory(
        _of_kernel(model, step, layout, room),
        {
            "numbers": room.array((groups, balloons, width), Lanes),
            "forces": room.array((groups, _places(layout, items) if adds_up else 0), layout.vector),
        },
        {
            "centers": room.array((groups, solids), Lanes3),
            "motions": room.array((groups, solids), Lanes3),
            "reaches": room.array((groups, solids), Lanes),
        },
        _working(model, features, groups * (LANES if layout.worlds else 1), room),
    )


def _places(layout: Layout, items: int) -> int:
    """Return the number of entries: of eight worlds, or of each particle of an octet."""
    return items if layout.worlds else LANES * items


def _of_kernel(model: Model, step: Step, layout: Layout, room: Room) -> dict[str, Any]:
    groups, items, takes = group_count(model, layout), items_of(model, layout).count, arguments_of(step, layout)
    faces = model.face_count if layout.worlds else len(face_octets(model))
    counts = {"particle": items, "face": faces, "balloon": model.balloon_count}
    arrays = {}
    for place in ("all_points", "other_points", "all_velocities", "other_velocities"):
        if place in takes:
            shown = "Seen" in takes[place]
            shape = (groups, _places(layout, items) if shown else items)
            arrays[place] = room.array(shape, layout.vector if shown else Lanes3)
    for name, (item, kind) in kinds_of(step, layout).items():
        shown = kind is layout.vector and not layout.worlds
        arrays[f"all_{name}"] = room.array((groups, LANES * counts[item] + 1 if shown else counts[item]), kind)
        if f"all_{name}_parts" in takes:
            arrays[f"all_{name}_parts"] = room.array((groups, LANES), kind)
    return arrays


def put_far_away(arrays: dict[str, Any], layout: Layout) -> None:
    """Place the padding face of octets far away, so that it is nearest to no particle."""
    if not layout.worlds and "all_face_center" in arrays:
        centers = arrays["all_face_center"].numpy()
        centers[:, -1] = FAR_AWAY
        arrays["all_face_center"].assign(centers)


def _working(model: Model, features: Features, worlds: int, room: Room) -> dict[str, Any]:
    spheres = model.sphere_count
    return {
        "gas_masses": room.array((worlds, model.balloon_count if features.gas else 0), wp.float32),
        "sphere_quanta": room.array((worlds, spheres if features.spheres_pushed else 0, 3), wp.int64),
        "sphere_starts": room.array((worlds, spheres if features.keeps_starts else 0), wp.vec3),
        "near": room.array((worlds, mark_count(model.particle_count) if features.impulses else 0), wp.int32),
    }


def rows_of(numbers: Any) -> Any:
    """Return numbers by group, lane and balloon: a row each."""
    groups, balloons, width = numbers.shape
    flat = wp.array(
        ptr=numbers.ptr, shape=(groups, balloons, width, LANES), dtype=wp.float32, device=numbers.device, copy=False
    )
    return flat.transpose((0, 3, 1, 2))
