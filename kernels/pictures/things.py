"""Things that are no balloons, in the rays of cameras: ground, spheres, obstacles and bodies."""

import warp as wp

from balloon_warp.kernels.laws.contact import BOX, CAPSULE, MESH
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.pictures.shapes import capsule_distance
from balloon_warp.kernels.pictures.sights import Sight, key_of, ray_of
from balloon_warp.kernels.tables import Solid, is_chosen, row_of_world

wp.set_module_options(OPTIONS)

MISSED = wp.constant(-1.0)
"""Distance of a thing that a ray does not hit"""
FARTHEST = wp.constant(1.0e30)
"""Distance beyond all that can be seen [m]"""


@wp.struct
class Things:
    """Things that a ray may hit besides balloons; empty where there are none."""

    up: wp.vec3
    frame: wp.array[wp.int32]
    has_ground: wp.int32
    ground_heights: wp.array[float]
    sphere_positions: wp.array2d[wp.vec3]
    sphere_radii: wp.array2d[float]
    obstacles: wp.array[Solid]
    obstacle_positions: wp.array2d[wp.vec3]
    obstacle_motion: wp.array2d[wp.transform]
    bodies: wp.array[Solid]
    body_positions: wp.array2d[wp.vec3]
    body_turns: wp.array2d[wp.quat]


@wp.struct
class Glance:
    """First thing on a ray: its distance [m], its number among all things, and its unit normal."""

    distance: float
    number: wp.int32
    normal: wp.vec3


@wp.func
def box_distance(half: wp.vec3, origin: wp.vec3, direction: wp.vec3):
    """Return the distance along a ray to a box about the origin, and the normal there."""
    near = float(-FARTHEST)
    far = float(FARTHEST)
    side = wp.int32(0)
    for axis in range(3):
        slope = direction[axis]
        if wp.abs(slope) < 1.0e-12:
            slope = wp.where(slope < 0.0, -1.0e-12, 1.0e-12)
        first = (-half[axis] - origin[axis]) / slope
        second = (half[axis] - origin[axis]) / slope
        if wp.min(first, second) > near:
            near = wp.min(first, second)
            side = axis
        far = wp.min(far, wp.max(first, second))
    if near > far or near <= 0.0:
        return MISSED, wp.vec3()
    normal = wp.vec3()
    normal[side] = wp.where(direction[side] < 0.0, 1.0, -1.0)
    return near, normal


@wp.func
def plane_distance(up: wp.vec3, height: float, origin: wp.vec3, direction: wp.vec3):
    """Return the distance along a ray to a plane across a unit vector, and the normal to the ray's side."""
    above = wp.dot(origin, up) - height
    slope = wp.dot(direction, up)
    if above * slope < 0.0:
        return -above / slope, wp.where(above > 0.0, up, -up)
    return MISSED, up


@wp.func
def solid_distance(solid: Solid, up: wp.vec3, origin: wp.vec3, direction: wp.vec3):
    """Return the distance along a ray to a solid [m], and the normal there, as the solid sees both."""
    distance, normal = plane_distance(up, 0.0, origin, direction)
    if solid.kind == BOX:
        of_box, out_of_box = box_distance(solid.size, origin, direction)
        distance = of_box
        normal = out_of_box
    elif solid.kind == CAPSULE:
        half = solid.size[1]
        distance = capsule_distance(origin, direction, -half * up, half * up, solid.size[0])
        point = origin + distance * direction
        normal = wp.normalize(point - wp.clamp(wp.dot(point, up), -half, half) * up)
    elif solid.kind == MESH:
        distance = MISSED
        query = wp.mesh_query_ray(solid.mesh, origin, direction, FARTHEST)
        if query.result:
            distance = query.t
            normal = wp.where(wp.dot(query.normal, direction) > 0.0, -query.normal, query.normal)
    return distance, normal


@wp.func
def nearer(glance: Glance, distance: float, number: wp.int32, normal: wp.vec3):
    """Return the nearer one: the hit before, or a thing at some distance."""
    if distance > 0.0 and distance < glance.distance:
        glance.distance = distance
        glance.number = number
        glance.normal = normal
    return glance


@wp.func
def glance_at_solids(things: Things, world: wp.int32, eye: wp.vec3, direction: wp.vec3, first: wp.int32, seen: Glance):
    """Return the nearest one: the hit before, or an obstacle or a body.

    Args:
        first: number of the first obstacle.
    """
    glance = seen
    frame = things.frame[row_of_world(world, things.frame.shape[0])]
    frame = wp.min(frame, things.obstacle_motion.shape[0] - 1)
    for obstacle in range(things.obstacles.shape[0]):
        moved = things.obstacle_motion[frame, obstacle]
        center = things.obstacle_positions[row_of_world(world, things.obstacle_positions.shape[0]), obstacle]
        center += wp.transform_get_translation(moved)
        turn = wp.transform_get_rotation(moved)
        distance, normal = solid_distance(
            things.obstacles[obstacle], things.up, wp.quat_rotate_inv(turn, eye - center),
            wp.quat_rotate_inv(turn, direction),
        )  # fmt: skip
        glance = nearer(glance, distance, first + obstacle, wp.quat_rotate(turn, normal))
    first_body = first + things.obstacles.shape[0]
    for body in range(things.bodies.shape[0]):
        turn = things.body_turns[world, body]
        distance, normal = solid_distance(
            things.bodies[body], things.up, wp.quat_rotate_inv(turn, eye - things.body_positions[world, body]),
            wp.quat_rotate_inv(turn, direction),
        )  # fmt: skip
        glance = nearer(glance, distance, first_body + body, wp.quat_rotate(turn, normal))
    return glance


@wp.kernel
def see_things(
    mask: wp.array[wp.int32],
    sights: wp.array[Sight],
    things: Things,
    # out
    keys: wp.array3d[wp.int64],
    normals: wp.array3d[wp.vec3],
):
    """Begin the keys of pixels with the first of all that is no balloon; a thread a (world, row, column).

    Normals are kept where there is room for them.
    """
    world, row, column = wp.tid()
    if not is_chosen(mask, world):
        return
    sight = sights[world]
    toward = ray_of(sight, row, column, keys.shape[1], keys.shape[2])
    direction = wp.normalize(toward)
    glance = Glance()
    glance.distance = FARTHEST
    if things.has_ground != 0:
        height = things.ground_heights[row_of_world(world, things.ground_heights.shape[0])]
        distance, normal = plane_distance(things.up, height, sight.eye, direction)
        glance = nearer(glance, distance, 0, normal)
    for sphere in range(things.sphere_positions.shape[1]):
        center = things.sphere_positions[world, sphere]
        radius = things.sphere_radii[row_of_world(world, things.sphere_radii.shape[0]), sphere]
        if radius > 0.0:
            distance = capsule_distance(sight.eye, direction, center, center, radius)
            out = wp.normalize(sight.eye + distance * direction - center)
            glance = nearer(glance, distance, 1 + sphere, out)
    glance = glance_at_solids(things, world, sight.eye, direction, 1 + things.sphere_positions.shape[1], glance)
    if glance.distance < FARTHEST:
        keys[world, row, column] = key_of(glance.distance / wp.length(toward), glance.number)
    else:
        keys[world, row, column] = key_of(wp.inf, 0)
    if normals.shape[0] > 0:
        normals[world, row, column] = glance.normal
