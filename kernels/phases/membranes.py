"""Membranes: forces face by face, wear, and tears.

Tearing of membranes: stresses of faces, the start of tears, and their propagation.

These phases precede the forces of a substep and follow the stresses of triangles. Each whole face looks for tears that
arrive, and tears in a launch of its own, so that the order of threads does not matter.
"""

from typing import Any

import warp as wp

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.tearing import WHOLE, across_tension, branch_plane, cuts, normal_of, plane_through
from balloon_warp.kernels.loops.areas import face_measures
from balloon_warp.kernels.loops.membranes import of_balloon
from balloon_warp.kernels.memory import vector_at
from balloon_warp.kernels.phase import Look, phase
from balloon_warp.kernels.tables import Tables, WorldState


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


LAST_FACE = wp.constant(wp.int64(2**31 - 1))
SQUARE_MICROMETERS = wp.constant(wp.float64(1.0e12))
"""Square micrometers in a square meter"""
center_of_face, area_vector_of_face = face_measures(vector_at)


@wp.func
def packed(stress: float, face: wp.int32):
    """Return stress and face as one number, whose maximum is the greatest stress, or the first face that has it."""
    bits = wp.int64(wp.cast(wp.max(stress, 0.0), wp.uint32))
    return (bits << wp.int64(32)) + LAST_FACE - wp.int64(face)


@wp.func
def unpacked(number: wp.int64):
    """Unpack the stress [Pa]."""
    return wp.cast(wp.uint32(number >> wp.int64(32)), wp.float32)


@wp.func
def face_of(number: wp.int64):
    """Read the face of an entry."""
    return wp.int32(LAST_FACE - (number & LAST_FACE))


@wp.func
def is_gone(torn: wp.array2d[float], world: wp.int32, face: wp.int32):
    return torn[world, face] >= 0.0


@wp.func
def weigh_faces(t: Tables, state: WorldState, world: wp.int32, face: wp.int32, time: float):
    """Weigh the stress of the faces that are not torn, and whether the balloon is to burst there.

    Torn faces do not pull.
    """
    tears = t.membranes.wear.tears
    begin = tears.triangle_offsets[face]
    end = tears.triangle_offsets[face + 1]
    gone = is_gone(state.torn, world, face)
    tears.gone[world, face] = wp.where(gone, wp.int8(1), wp.int8(0))
    stress = float(0.0)
    for entry in range(begin, end):
        triangle = tears.triangles[entry]
        stress += tears.stresses[world, triangle]
        if gone:
            t.membranes.wear.left[world, triangle] = 0.0
    stress /= wp.max(float(end - begin), 1.0)
    tears.face_stresses[world, face] = stress
    balloon = t.faces.balloon[face]
    if end > begin and not gone and state.bursts[world, balloon][0] < 0.0:
        pierced = time >= of_balloon(tears.needle_time, world, balloon)
        if pierced or stress >= of_balloon(tears.film_strength, world, balloon):
            wp.atomic_max(tears.weakest, world, balloon, packed(stress, face))


@wp.func
def is_cut(t: Tables, plane: wp.vec4, edge: wp.vec2i):
    """Return whether a tear's plane cuts an edge."""
    rests = t.membranes.wear.tears.rests
    return cuts(plane, rests[edge[0]], rests[edge[1]])


@wp.func
def middle_of(t: Tables, edge: wp.vec2i):
    """Return the midpoint of an edge on the unstretched skin."""
    rests = t.membranes.wear.tears.rests
    return 0.5 * (rests[edge[0]] + rests[edge[1]])


@wp.func
def branch_of(t: Tables, plane: wp.vec4, burst: wp.vec4, world: wp.int32, face: wp.int32):
    """Find the entry of the neighbor to which a tear branches off from a torn face, or -1.

    It branches where it begins, and each time that it has gone as far again from there.
    """
    tears = t.membranes.wear.tears
    balloon = t.faces.balloon[face]
    if burst[3] <= of_balloon(tears.branching_stress, world, balloon):
        return wp.int32(-1)
    first = wp.int32(burst[2])
    nearest = float(1.0e30)
    farthest = float(0.0)
    flank = wp.int32(-1)
    for entry in range(tears.neighbor_offsets[face], tears.neighbor_offsets[face + 1]):
        edge = tears.edges[entry]
        if is_cut(t, plane, edge):
            way = wp.length(middle_of(t, edge) - tears.centers[first]) / tears.ways[balloon]
            nearest = wp.min(nearest, way)
            farthest = wp.max(farthest, way)
        elif flank < 0 or (face & 1) == 1:
            flank = entry + 0
    times = wp.min(wp.int32(farthest), tears.branchings[balloon] - 1)
    if (face == first and tears.branchings[balloon] > 0) or (times > 0 and nearest < float(times)):
        return flank
    return wp.int32(-1)


@wp.func
def tear_across(
    t: Tables,
    burst: wp.vec4,
    torn: wp.array2d[float],
    planes: wp.array2d[wp.vec4],
    world: wp.int32,
    face: wp.int32,
    entry: wp.int32,
):
    """Return the distance of a neighbor's tear beyond a face [m], negative if it does not reach it, and its plane."""
    tears = t.membranes.wear.tears
    other = tears.neighbors[entry]
    reach = torn[world, other]
    plane = planes[world, other]
    edge = tears.edges[entry]
    if reach < 0.0:
        return WHOLE, plane
    step = tears.centers[face] - tears.centers[other]
    heading = wp.cross(normal_of(plane), tears.normals[other])
    begins = other == wp.int32(burst[2])
    if is_cut(t, plane, edge):
        if begins and wp.dot(heading, step) < 0.0:  # it runs both ways from there
            plane = -plane
        across = wp.dot(normal_of(plane), step)
        return reach - wp.sqrt(wp.max(wp.length_sq(step) - across * across, 0.0)), plane
    branch = branch_of(t, plane, burst, world, other)
    if branch < 0:
        return WHOLE, plane
    if tears.neighbors[branch] != face:
        return WHOLE, plane
    if begins:
        heading = wp.vec3()
    return reach - wp.length(step), branch_plane(heading, step, tears.normals[face], middle_of(t, edge))


@wp.func
def first_plane(t: Tables, points: wp.array[wp.vec3], face: wp.int32):
    """Return the plane of a tear that begins in a face: across the largest tension."""
    tears = t.membranes.wear.tears
    a = t.faces.particles[t.faces.offsets[face]]
    b = t.faces.particles[t.faces.offsets[face] + 1]
    c = t.faces.particles[t.faces.offsets[face] + 2]
    normal = across_tension(
        tears.rests[b] - tears.rests[a], tears.rests[c] - tears.rests[a], points[b] - points[a], points[c] - points[a]
    )
    return plane_through(normal, tears.centers[face])


@wp.func
def run_tears(t: Tables, state: WorldState, points: wp.array[wp.vec3], world: wp.int32, face: wp.int32):
    """Find whether a tear begins at a face, or arrives there."""
    tears = t.membranes.wear.tears
    tears.ahead[world, face] = WHOLE
    if is_gone(state.torn, world, face):
        return
    balloon = t.faces.balloon[face]
    burst = state.bursts[world, balloon]
    stress = tears.face_stresses[world, face]
    if burst[0] < 0.0:
        weakest = tears.weakest[world, balloon]
        if weakest > wp.int64(0) and weakest == packed(stress, face):
            tears.ahead[world, face] = 0.0
            state.tear_planes[world, face] = first_plane(t, points, face)
    elif stress > of_balloon(tears.tear_strength, world, balloon):
        for entry in range(tears.neighbor_offsets[face], tears.neighbor_offsets[face + 1]):
            if tears.ahead[world, face] < 0.0:
                ahead, plane = tear_across(t, burst, state.torn, state.tear_planes, world, face, entry)
                if ahead >= 0.0:
                    most = of_balloon(tears.tear_speed, world, balloon) * t.step_seconds
                    tears.ahead[world, face] = wp.min(ahead, most)  # however long it has waited
                    state.tear_planes[world, face] = plane


@wp.func
def area_of(t: Tables, points: wp.array[wp.vec3], face: wp.int32):
    """Return the current area of a face, in square micrometers."""
    area = wp.length(area_vector_of_face(t.faces, points, face, center_of_face(t.faces, points, face)))
    return wp.int64(wp.float64(area) * SQUARE_MICROMETERS)


@wp.func
def tear_faces(t: Tables, state: WorldState, points: wp.array[wp.vec3], world: wp.int32, face: wp.int32):
    """Tear the faces that a tear has reached, and let other tears advance."""
    tears = t.membranes.wear.tears
    balloon = t.faces.balloon[face]
    gone = is_gone(state.torn, world, face)
    if gone:
        state.torn[world, face] += of_balloon(tears.tear_speed, world, balloon) * t.step_seconds
    elif tears.ahead[world, face] >= 0.0:
        state.torn[world, face] = tears.ahead[world, face]
        tears.gone[world, face] = wp.int8(1)
        for entry in range(tears.triangle_offsets[face], tears.triangle_offsets[face + 1]):
            t.membranes.wear.left[world, tears.triangles[entry]] = 0.0
        gone = bool(True)
    if gone or state.bursts[world, balloon][0] >= 0.0:
        wp.atomic_add(tears.areas, world, balloon, wp.where(gone, 0, 1), area_of(t, points, face))
