"""What the `block` schedule's kernel for worlds of any size consists of, and what it shares with the resident ones.

A tile holds two buffers of points, of which a substep reads one and writes the other.
"""

from typing import Any

import warp as wp

from balloon_warp.kernels.contact import leave_ground, leave_sphere, penalty_force
from balloon_warp.kernels.fixed_point import add_quanta, set_quanta, total_newtons
from balloon_warp.kernels.inflation import FAR, aim_of, face_area_vector, face_center, nearer_area
from balloon_warp.kernels.tables import FaceTable, ObstacleTable, WorldState, ground_friction, row_of_world

FORCE_ROWS = 3
"""rows of the spheres' forces in a world: a substep adds to one, reads that of the last, and clears that of the next"""


@wp.func
def row_of(spheres: Any, sphere: wp.int32):
    """The vector of one sphere."""
    return wp.vec3(spheres[sphere, 0], spheres[sphere, 1], spheres[sphere, 2])


@wp.func
def force_row(world: wp.int32, substep: wp.int32):
    """Where the forces on spheres of a substep are summed."""
    return FORCE_ROWS * world + (substep + FORCE_ROWS) % FORCE_ROWS


@wp.func
def balloon_area(faces: FaceTable, points: Any, first: wp.int32, balloon: wp.int32, lane: wp.int32):
    """Area of a balloon, summed by the whole block in the same order every time."""
    part = float(0.0)
    for face in range(faces.balloon_offsets[balloon] + lane, faces.balloon_offsets[balloon + 1], wp.block_dim()):
        begin = faces.offsets[face]
        end = faces.offsets[face + 1]
        center = face_center(points, first, faces.particles, begin, end)
        part += wp.length(face_area_vector(points, first, faces.particles, begin, end, center))
    total = wp.tile_sum(wp.tile(part))
    return total[0]


@wp.func
def aim_in_tile(faces: FaceTable, points: Any, first: wp.int32, particle: wp.int32, point: wp.vec3, total_area: float):
    """(A_p / A_total) n of a particle, its faces measured on the way."""
    normal = wp.vec3()
    nearest = wp.vec2(FAR, 0.0)
    for incidence in range(faces.particle_offsets[particle], faces.particle_offsets[particle + 1]):
        face = faces.around_particles[incidence]
        begin = faces.offsets[face]
        end = faces.offsets[face + 1]
        center = face_center(points, first, faces.particles, begin, end)
        area_vector = face_area_vector(points, first, faces.particles, begin, end, center)
        normal += wp.normalize(area_vector)
        nearest = nearer_area(nearest, point, center, area_vector)
    return aim_of(normal, nearest, total_area)


@wp.func
def count_frame_in_block(state: WorldState, world: wp.int32, lane: wp.int32):
    """By one thread of all: the frame has passed. It was read before this launch."""
    if world == 0 and lane == 0:
        state.frame[0] = state.frame[0] + 1


@wp.struct
class SphereForces:
    """Forces on the spheres in the substeps of a frame."""

    totals: wp.array3d[wp.int64]
    """see `fixed_point`, shape (FORCE_ROWS * world_count, sphere_count, 3)"""
    stamps: wp.array2d[wp.int32]
    """the last substep in which something was added to a row, shape (world_count, FORCE_ROWS)"""


@wp.func
def begin_sphere_forces(state: WorldState, forces: SphereForces, world: wp.int32):
    """By one thread, before the first substep: the forces since the spheres last moved."""
    for sphere in range(state.sphere_positions.shape[1]):
        set_quanta(forces.totals, force_row(world, -1), sphere, state.sphere_forces[world, sphere])
        set_quanta(forces.totals, force_row(world, 0), sphere, wp.vec3())
        set_quanta(forces.totals, force_row(world, 1), sphere, wp.vec3())
    forces.stamps[world, FORCE_ROWS - 1] = -1
    forces.stamps[world, 0] = -FORCE_ROWS
    forces.stamps[world, 1] = -FORCE_ROWS


@wp.func
def were_touched(stamps: wp.array[wp.int32], substep: wp.int32):
    """Whether a particle touched a sphere of the world in a substep that is over."""
    return stamps[(substep + FORCE_ROWS) % FORCE_ROWS] == substep


@wp.func
def clear_sphere_force(forces: SphereForces, world: wp.int32, sphere: wp.int32, substep: wp.int32):
    """By one thread: a row that all threads have read."""
    set_quanta(forces.totals, force_row(world, substep), sphere, wp.vec3())


@wp.func
def add_penalty(
    obstacles: ObstacleTable,
    forces: SphereForces,
    world: wp.int32,
    sphere: wp.int32,
    substep: wp.int32,
    inflation: wp.vec3,
    outward: wp.vec3,
):
    """What a particle that left a sphere adds to the sphere's forces of this substep."""
    penalty = obstacles.sphere_penalty[row_of_world(world, obstacles.sphere_penalty.shape[0]), sphere]
    row = force_row(world, substep)
    add_quanta(forces.totals, row, sphere, penalty_force(penalty, inflation, outward))
    forces.stamps[world, substep % FORCE_ROWS] = substep


@wp.func
def sphere_radius(obstacles: ObstacleTable, world: wp.int32, sphere: wp.int32):
    """[m]"""
    return obstacles.sphere_radius[row_of_world(world, obstacles.sphere_radius.shape[0]), sphere]


@wp.func
def meet_sphere(
    obstacles: ObstacleTable,
    forces: SphereForces,
    world: wp.int32,
    sphere: wp.int32,
    substep: wp.int32,
    point: wp.vec3,
    velocity: wp.vec3,
    center: wp.vec3,
    sphere_velocity: wp.vec3,
    radius: float,
    up: wp.vec3,
    inflation: wp.vec3,
    active: bool,
):
    """A particle out of a sphere, which gets its penalty; most are outside and go on at once."""
    if wp.length_sq(point - center) >= radius * radius:
        return point, velocity
    new_point, new_velocity, outward = leave_sphere(point, velocity, center, sphere_velocity, radius, up)
    if active:
        add_penalty(obstacles, forces, world, sphere, substep, inflation, outward)
    return new_point, new_velocity


@wp.func
def meet_ground(
    obstacles: ObstacleTable, world: wp.int32, point: wp.vec3, velocity: wp.vec3, up: wp.vec3, height: float
):
    """A particle up to the ground; most are above and go on at once."""
    if wp.dot(point, up) >= height:
        return point, velocity
    new_point, new_velocity = leave_ground(point, velocity, up, height, ground_friction(obstacles, world))
    return new_point, new_velocity


@wp.func
def acceleration_by_touch(
    obstacles: ObstacleTable,
    forces: SphereForces,
    touched: bool,
    world: wp.int32,
    sphere: wp.int32,
    substep: wp.int32,
):
    """Acceleration of a sphere by the penalties of a substep [m/s^2]; most have none."""
    if not touched:
        return wp.vec3()
    mass = obstacles.sphere_mass[row_of_world(world, obstacles.sphere_mass.shape[0]), sphere]
    return total_newtons(forces.totals, force_row(world, substep), sphere) / mass
