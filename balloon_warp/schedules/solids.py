"""Memory for free bodies and for small spheres that meet faces."""

from typing import Any

import warp as wp

from balloon_warp.kernels.contact.faces import MOST_IN_LUMP
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.grip import Grip
from balloon_warp.model import Model
from balloon_warp.model.bodies import most_touches
from balloon_warp.model.memory import Room


def solid_arrays(model: Model, features: Features, room: Room) -> dict[str, Any]:
    """Return the arrays of `Working` for bodies and colliding spheres; empty where a scene does not need them."""
    worlds = model.world_count
    bodies = model.body_count if features.bodies else 0
    particles = model.particle_count
    return {
        "sphere_starts": room.array((worlds, model.sphere_count if features.keeps_starts else 0), wp.vec3),
        "body_starts": room.array((worlds, bodies), wp.vec3),
        "body_start_turns": room.array((worlds, bodies), wp.quat),
        "body_masses": room.array((worlds, bodies), wp.float32),
        "body_eases": room.array((worlds, bodies), wp.mat33d),
        "body_going": room.array((worlds, bodies), wp.vec3d),
        "body_turning": room.array((worlds, bodies), wp.vec3d),
        "body_quanta": room.array((worlds, bodies if features.bodies_shoved else 0, 3), wp.int64),
        "body_turning_quanta": room.array((worlds, bodies if features.bodies_shoved else 0, 3), wp.int64),
        "body_tugs": room.array((worlds, bodies if features.ties else 0), wp.vec3),
        "body_twists": room.array((worlds, bodies if features.ties else 0), wp.vec3),
        "body_groups": room.array((worlds, bodies), wp.int32),
        "body_gains": room.array((worlds, bodies), wp.vec4d),
        "grips": room.array((worlds, most_touches(model.bodies) if bodies else 0), Grip),
        "point_starts": room.array((worlds, particles if features.small_spheres else 0), wp.vec3),
        "lumps": room.array((worlds, int(MOST_IN_LUMP) if features.small_spheres else 0), wp.int32),
    }
