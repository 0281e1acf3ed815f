"""Access of particles to the forces of membranes whose faces are measured once."""

from functools import cache
from typing import Any, NamedTuple

import warp as wp

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.loops.membranes import MembraneFaceLayout, membrane_faces_of
from balloon_warp.kernels.loops.net_force import Loops, scalar_loops
from balloon_warp.kernels.loops.quads import quads_of
from balloon_warp.kernels.loops.slots import Slots, slot_loop, springs_reader
from balloon_warp.kernels.loops.springs import spring_loop
from balloon_warp.kernels.memory import in_tile
from balloon_warp.kernels.tables import Tables


class MembraneFaceFunctions(NamedTuple):
    """Hold the functions and layout that phases ask for, see `phases.stretch`."""

    clear: Any
    stretch: Any
    collect: Any
    loops: Loops
    keeps: Any
    """Function that reads the faces that a thread keeps as a frame begins, if it keeps any"""
    layout: MembraneFaceLayout
    keeps_places: bool
    """Whether particles keep where their faces' forces stand"""


@cache
def kept_springs(features: Features, membrane_face: MembraneFaceLayout, slots: Slots) -> tuple[Any, Any]:
    """Return the type of a particle's kept springs and places of faces, and the function that reads them."""
    Springs, read_springs = springs_reader(features, slots)  # noqa: N806 - a type
    read_places = membrane_faces_of(features, membrane_face).read_places

    @wp.struct
    class Kept:
        """Springs, and the places of the faces' forces on the particle."""

        springs: Springs
        places: wp.vec4i

    @wp.func
    def read_kept(t: Tables, slot_table: Any, params: Any, place: wp.int32, active: bool):
        kept = Kept()
        kept.springs = read_springs(t, slot_table, params, place, active)
        kept.places = read_places(t, params, active)
        return kept

    return Kept, read_kept


@cache
def skin_functions(features: Features, membrane_face: MembraneFaceLayout, slots: Slots | None) -> tuple[Any, Any, Any]:
    """Return functions that collect membrane forces on a particle, and add them and area vectors to its springs' sums.

    The first collects, the second adds to the force, and the third returns the area vector.
    """
    take = membrane_faces_of(features, membrane_face).take
    kept_type: Any = springs_reader(features, slots)[0] if slots else wp.int32
    pull_of_springs = slot_loop(features, slots) if slots else spring_loop(features, in_tile)
    has_springs = slots is None or sum(slots) > 0

    @wp.struct
    class Skin:
        """Membrane forces on a particle, and its springs."""

        springs: kept_type
        pull: wp.vec3
        area_vector: wp.vec3

    @wp.func
    def collect_kept(t: Tables, params: Any, kept: Any, pulls: Any, area_vectors: Any):
        skin = Skin()
        skin.springs = kept.springs
        pull, area_vector = take(t, params, kept.places, pulls, area_vectors)
        skin.pull = pull
        skin.area_vector = area_vector
        return skin

    @wp.func
    def collect(t: Tables, params: Any, pulls: Any, area_vectors: Any):
        skin = Skin()
        pull, area_vector = take(t, params, wp.vec4i(), pulls, area_vectors)
        skin.pull = pull
        skin.area_vector = area_vector
        return skin

    @wp.func
    def pull_of_skin(
        t: Tables, points: Any, velocities: Any, params: Any, skin: Any, point: wp.vec3, velocity: wp.vec3, time: float
    ):
        """Return the net force of springs and faces [N]."""
        if wp.static(has_springs):
            return pull_of_springs(t, points, velocities, params, skin.springs, point, velocity, time) + skin.pull
        else:
            return skin.pull

    @wp.func
    def area_vector_of_skin(t: Tables, points: Any, params: Any, skin: Any, point: wp.vec3):
        """Return the area vector of a particle [m^2]."""
        return skin.area_vector

    return collect_kept if slots else collect, pull_of_skin, area_vector_of_skin


@cache
def membrane_face_functions(
    features: Features, membrane_face: MembraneFaceLayout, slots: Slots | None
) -> MembraneFaceFunctions:
    """Return the functions of faces, and of particles.

    Args:
        slots: of springs that particles keep, if they do.
    """
    membrane_faces = membrane_faces_of(features, membrane_face)
    quads = quads_of(features, membrane_face) if membrane_face.quads else None
    collect, pull, area_vector = skin_functions(features, membrane_face, slots)

    beside = features._replace(membranes=())
    return MembraneFaceFunctions(
        membrane_faces.clear,
        quads.stretch if quads else membrane_faces.stretch,
        collect,
        scalar_loops(beside, in_tile, pull, area_vector if membrane_face.areas else None),
        quads.hold if quads else None,
        membrane_face,
        slots is not None,
    )
