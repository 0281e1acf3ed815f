"""Forces of laws on faces: each is found once, and its corners read it."""

from typing import Any

import warp as wp

from balloon_warp.kernels.loops.faces import face_push, push_of_faces
from balloon_warp.kernels.phase import Look, phase
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.traits import Traits


def _acts_on_faces(traits: Traits) -> bool:
    return traits.has("face")


@phase("face", {"face_push": wp.vec3}, when=_acts_on_faces)
def push_face(traits: Traits, look: Look) -> Any:
    """Find the force on a face, each corner's share [N]."""
    push_at_corner = face_push(traits, look.at, look.velocity_at)

    @wp.func
    def push_face(t: Tables, world: wp.int32, face: wp.int32, points: Any, time: float):
        return push_at_corner(t, points, points, world, face, time)

    @wp.func
    def push_by_velocities(t: Tables, world: wp.int32, face: wp.int32, points: Any, velocities: Any, time: float):
        return push_at_corner(t, points, velocities, world, face, time)

    return push_by_velocities if traits.needs("face", "velocity") else push_face


@phase("particle", {"force": wp.vec3}, when=_acts_on_faces)
def bear(traits: Traits, look: Look) -> Any:
    """Add the forces on its faces to a particle."""

    @wp.func
    def bear(t: Tables, face_pushes: Any, particle: wp.int32, force: wp.vec3):
        return force + push_of_faces(t, face_pushes, particle)

    return bear
