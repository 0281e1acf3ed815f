"""Membranes face by face, where each is measured once for all of its corners."""

from typing import Any

import warp as wp

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.phase import Look, phase
from balloon_warp.kernels.tables import Tables


def _has_membranes(features: Features) -> bool:
    return bool(features.membranes)


@phase("world", when=_has_membranes, once=lambda features: True)
def clear(features: Features, look: Look) -> Any:
    """Clear the unused entries of particles that have fewer faces than others."""
    return look.membrane_faces(features).clear


@phase("membrane_face", when=_has_membranes)
def stretch(features: Features, look: Look) -> Any:
    """Measure a face, and store its forces at its corners."""
    if look.membrane_faces(features).keeps:
        return look.membrane_faces(features).stretch
    stretch_face = look.membrane_faces(features).stretch

    @wp.func
    def stretch(t: Tables, world: wp.int32, membrane_face: wp.int32, points: Any, pulls: Any, area_vectors: Any):
        stretch_face(t, world, membrane_face, points, points, pulls, area_vectors)

    @wp.func
    def stretch_by_velocities(
        t: Tables, world: wp.int32, membrane_face: wp.int32, points: Any, velocities: Any, pulls: Any, area_vectors: Any
    ):
        stretch_face(t, world, membrane_face, points, velocities, pulls, area_vectors)

    return stretch_by_velocities if features.viscous else stretch


@phase("particle", {"skin": Any}, when=_has_membranes)
def collect(features: Features, look: Look) -> Any:
    """Sum the forces of its faces on a particle."""
    return look.membrane_faces(features).collect
