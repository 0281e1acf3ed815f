"""Which way a normal force pushes, and the force of any inflation, where a launch finds it."""

import warp as wp

from balloon_warp.kernels.laws.columns import Columns
from balloon_warp.kernels.loops.aims import aim_loop
from balloon_warp.kernels.loops.areas import face_measures
from balloon_warp.kernels.memory import vector_at
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.substep import inflation_of, ramp_at
from balloon_warp.kernels.tables import FaceTable, ParticleTable, WorldState
from balloon_warp.kernels.traits import Traits

wp.set_module_options({**OPTIONS, "enable_backward": False})

center_of_face, area_vector_of_face = face_measures(vector_at)
aim_of_particle = aim_loop(vector_at)
inflation = inflation_of(Traits((), Columns((), ()), aims=True, pressures=True))
"""of any kind"""


@wp.kernel
def measure_faces(
    # model
    faces: FaceTable,
    # state in
    points: wp.array2d[wp.vec3],
    # out
    face_centers: wp.array2d[wp.vec3],
    face_area_vectors: wp.array2d[wp.vec3],
):
    """A thread a (world, face): its center, and its area vector (area times unit normal)."""
    world, face = wp.tid()
    center = center_of_face(faces, points[world], face)
    face_centers[world, face] = center
    face_area_vectors[world, face] = area_vector_of_face(faces, points[world], face, center)


@wp.kernel
def sum_face_areas(
    # model
    faces: FaceTable,
    # state in
    face_area_vectors: wp.array2d[wp.vec3],
    # out
    balloon_areas: wp.array2d[float],
):
    """A block a (world, balloon): the area of the balloon, summed in the same order every time."""
    world, balloon, thread = wp.tid()
    part = float(0.0)
    for face in range(faces.balloon_offsets[balloon] + thread, faces.balloon_offsets[balloon + 1], wp.block_dim()):
        part += wp.length(face_area_vectors[world, face])
    wp.tile_store(balloon_areas[world], wp.tile_sum(wp.tile(part)), offset=balloon)


@wp.kernel
def aim_inflation(
    # model
    particles: ParticleTable,
    faces: FaceTable,
    # state in
    points: wp.array2d[wp.vec3],
    face_centers: wp.array2d[wp.vec3],
    face_area_vectors: wp.array2d[wp.vec3],
    balloon_areas: wp.array2d[float],
    # out
    aims: wp.array2d[wp.vec3],
):
    """A thread a (world, particle): (A_p / A_total) n."""
    world, particle = wp.tid()
    aims[world, particle] = aim_of_particle(
        faces,
        face_centers[world],
        face_area_vectors[world],
        particle,
        points[world, particle],
        balloon_areas[world, particles.balloon[particle]],
    )


@wp.kernel
def add_inflation_forces(
    # model
    particles: ParticleTable,
    inflation_kind: wp.array[wp.int32],
    up: wp.vec3,
    given: bool,
    time_in_frame: float,
    # state in
    state: WorldState,
    aims: wp.array2d[wp.vec3],
    area_vectors: wp.array2d[wp.vec3],
    # out
    forces: wp.array2d[wp.vec3],
):
    """A thread a (world, particle): the force of its balloon's inflation, whose pressures are given, or the state's."""
    world, particle = wp.tid()
    balloon = particles.balloon[particle]
    value = ramp_at(state, world, balloon, time_in_frame)
    load = state.inflation_loads[world, balloon]
    if given:
        load = wp.vec2(value, 0.0)
    forces[world, particle] += inflation(
        inflation_kind[balloon], value, load[0], load[1], up, state.points[world, particle],
        aims[world, particle], area_vectors[world, particle],
    )  # fmt: skip
