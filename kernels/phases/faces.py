"""Forces of laws on faces: each is found once, and its corners read it."""

from typing import Any

import warp as wp

from balloon_warp.kernels.adjoints.derived import nothing
from balloon_warp.kernels.adjoints.faces import bear_backwards
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.loops.faces import face_push, push_of_faces_function
from balloon_warp.kernels.phase import Look, phase
from balloon_warp.kernels.tables import Tables


def _acts_on_faces(features: Features) -> bool:
    return features.has("face")


@phase("face", {"face_push": wp.vec3}, when=_acts_on_faces, adjoint=nothing)
def push_face(features: Features, look: Look) -> Any:
    """Find the force on a face, each corner's share [N]."""
    push_at_corner = face_push(features, look.at, look.velocity_at)

    @wp.func
    def push_face(t: Tables, world: wp.int32, face: wp.int32, points: Any, time: float):
        return push_at_corner(t, points, points, world, face, time)

    @wp.func
    def push_by_velocities(t: Tables, world: wp.int32, face: wp.int32, points: Any, velocities: Any, time: float):
        return push_at_corner(t, points, velocities, world, face, time)

    return push_by_velocities if features.needs("face", "velocity") else push_face


@phase("particle", {"force": wp.vec3}, when=_acts_on_faces, adjoint=bear_backwards)
def bear(features: Features, look: Look) -> Any:
    """Add the forces on its faces to a particle."""
    push_of_faces = push_of_faces_function(features)

    @wp.func
    def bear(t: Tables, face_pushes: Any, particle: wp.int32, force: wp.vec3):
        return force + push_of_faces(t, face_pushes, particle)

    return bear
