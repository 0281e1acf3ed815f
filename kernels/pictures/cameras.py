"""Cameras that look into many worlds at once, by a ray through the middle of each pixel.

Such pictures are small and many, and all that they show moves in every frame. So each triangle finds the rays that hit
it, which needs no tree. The first hit of a ray is the least of keys, of its depth, and the thing's number. A mask
chooses the worlds that are looked at; one without entries chooses all.
"""

import warp as wp

from balloon_warp.kernels import OPTIONS
from balloon_warp.kernels.laws.contact import BOX, CAPSULE, MESH
from balloon_warp.kernels.pictures.surfaces import (
    KEY,
    KEY_RADIANCE,
    backdrop,
    capsule_distance,
    sky_irradiance,
    srgb_byte,
    tone,
)
from balloon_warp.kernels.tables import Solid, is_chosen, row_of_world

wp.set_module_options(OPTIONS)


@wp.struct
class PinholeCamera:
    """A pinhole camera; `right` and `up` reach from the middle of the picture to its edges at depth one."""

    eye: wp.vec3
    forward: wp.vec3
    right: wp.vec3
    up: wp.vec3


@wp.func
def ray_of(sight: PinholeCamera, row: wp.int32, column: wp.int32, height: wp.int32, width: wp.int32):
    """Return the ray through the middle of a pixel, which reaches depth one."""
    x = 2.0 * (float(column) + 0.5) / float(width) - 1.0
    y = 1.0 - 2.0 * (float(row) + 0.5) / float(height)
    return sight.forward + x * sight.right + y * sight.up


@wp.func
def key_of(depth: float, number: wp.int32):
    """Return a number that is the less the nearer a thing is; floats above 0 are in order as integers, too."""
    return (wp.int64(wp.cast(depth, wp.int32)) << wp.int64(32)) + wp.int64(number)


@wp.func
def depth_of(key: wp.int64):
    """Return the depth in a key [m], infinite where nothing is seen."""
    return wp.cast(wp.int32(key >> wp.int64(32)), wp.float32)


@wp.func
def number_of(key: wp.int64):
    """Return the number of the thing in a key."""
    return wp.int32(key & wp.int64(0x7FFFFFFF))


@wp.kernel
def aim(
    eyes: wp.array[wp.vec3],
    targets: wp.array[wp.vec3],
    up: wp.vec3,
    half_width: float,
    half_height: float,
    # out
    sights: wp.array[PinholeCamera],
):
    """Turn cameras to their targets, with the up axis upwards in the picture; a thread a world."""
    world = wp.tid()
    sight = PinholeCamera()
    sight.eye = eyes[world]
    sight.forward = wp.normalize(targets[world] - eyes[world])
    across = wp.cross(sight.forward, up)
    if wp.length(across) < 1.0e-4:  # straight up or down
        across = wp.vec3(1.0, 0.0, 0.0)
    right = wp.normalize(across)
    sight.right = half_width * right
    sight.up = half_height * wp.cross(right, sight.forward)
    sights[world] = sight


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
class FirstHit:
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
def nearer(glance: FirstHit, distance: float, number: wp.int32, normal: wp.vec3):
    """Return the nearer one: the hit before, or a thing at some distance."""
    if distance > 0.0 and distance < glance.distance:
        glance.distance = distance
        glance.number = number
        glance.normal = normal
    return glance


@wp.func
def hit_solids(things: Things, world: wp.int32, eye: wp.vec3, direction: wp.vec3, first: wp.int32, seen: FirstHit):
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
def cast_things(
    mask: wp.array[wp.int32],
    sights: wp.array[PinholeCamera],
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
    glance = FirstHit()
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
    glance = hit_solids(things, world, sight.eye, direction, 1 + things.sphere_positions.shape[1], glance)
    if glance.distance < FARTHEST:
        keys[world, row, column] = key_of(glance.distance / wp.length(toward), glance.number)
    else:
        keys[world, row, column] = key_of(wp.inf, 0)
    if normals.shape[0] > 0:
        normals[world, row, column] = glance.normal


KEY_LIGHT = wp.constant(wp.vec3(*KEY))
KEY_LIGHT_RADIANCE = wp.constant(wp.vec3(*KEY_RADIANCE))
BESIDE = wp.constant(1.0e-3)
"""Least depth of a triangle's corner over that of another, at which the triangle is not beside the camera"""
SEAM = wp.constant(1.0e-6)
"""Part of an edge's reach by which triangles overlap, so that rounding leaves no gap between two"""


@wp.func
def pixels_between(least: float, most: float, count: wp.int32):
    """Return the first and the last pixel whose middles are between two coordinates, -1 and 1 at the edges."""
    last = float(count - 1)
    first_pixel = wp.ceil(wp.clamp((least + 1.0) * 0.5 * float(count) - 0.51, 0.0, last + 1.0))
    last_pixel = wp.floor(wp.clamp((most + 1.0) * 0.5 * float(count) - 0.49, -1.0, last))
    return wp.int32(first_pixel), wp.int32(last_pixel)


@wp.kernel
def rasterize_triangles(
    mask: wp.array[wp.int32],
    sights: wp.array[PinholeCamera],
    corners: wp.array[wp.vec3i],
    faces: wp.array[wp.int32],
    torn: wp.array2d[float],
    points: wp.array2d[wp.vec3],
    first: wp.int32,
    # in and out
    keys: wp.array3d[wp.int64],
):
    """Rasterize triangles into the depth keys, but for torn ones; a thread a (world, triangle).

    Args:
        faces: of which the triangles are.
        first: number of the first triangle among all things.
    """
    world, triangle = wp.tid()
    if not is_chosen(mask, world):
        return
    if torn.shape[1] > 0 and torn[world, faces[triangle]] >= 0.0:
        return
    sight = sights[world]
    p = corners[triangle]
    a = points[world, p[0]] - sight.eye
    b = points[world, p[1]] - sight.eye
    c = points[world, p[2]] - sight.eye
    depths = wp.vec3(wp.dot(a, sight.forward), wp.dot(b, sight.forward), wp.dot(c, sight.forward))
    if not wp.isfinite(wp.length_sq(a) + wp.length_sq(b) + wp.length_sq(c)) or wp.max(depths) <= 0.0:
        return
    height = keys.shape[1]
    width = keys.shape[2]
    top = wp.int32(0)
    bottom = height - 1
    left = wp.int32(0)
    right = width - 1
    if wp.min(depths) > BESIDE * wp.max(depths):
        over_x = 1.0 / wp.length_sq(sight.right)
        over_y = -1.0 / wp.length_sq(sight.up)
        x = over_x * wp.cw_div(wp.vec3(wp.dot(a, sight.right), wp.dot(b, sight.right), wp.dot(c, sight.right)), depths)
        y = over_y * wp.cw_div(wp.vec3(wp.dot(a, sight.up), wp.dot(b, sight.up), wp.dot(c, sight.up)), depths)
        left, right = pixels_between(wp.min(x), wp.max(x), width)
        top, bottom = pixels_between(wp.min(y), wp.max(y), height)
    normal = wp.cross(b - a, c - a)
    above = wp.dot(a, normal)
    of_a = wp.cross(b, c - b)
    of_b = wp.cross(c, a - c)
    of_c = wp.cross(a, b - a)
    slack_a = SEAM * wp.length(b) * wp.length(c - b)
    slack_b = SEAM * wp.length(c) * wp.length(a - c)
    slack_c = SEAM * wp.length(a) * wp.length(b - a)
    for row in range(top, bottom + 1):
        for column in range(left, right + 1):
            toward = ray_of(sight, row, column, height, width)
            side = wp.sign(wp.dot(toward, normal))
            inside = side * wp.dot(toward, of_a) >= -slack_a and side * wp.dot(toward, of_b) >= -slack_b
            if inside and side * wp.dot(toward, of_c) >= -slack_c:
                depth = above / wp.dot(toward, normal)
                if depth > 0.0:
                    depth = wp.clamp(depth, wp.min(depths), wp.max(depths))
                    wp.atomic_min(keys, world, row, column, key_of(depth, first + triangle))


@wp.kernel
def decode_depths(mask: wp.array[wp.int32], keys: wp.array3d[wp.int64], depths: wp.array3d[float]):
    """Decode depths from keys; a thread a (world, row, column)."""
    world, row, column = wp.tid()
    if not is_chosen(mask, world):
        return
    depths[world, row, column] = depth_of(keys[world, row, column])


@wp.func
def key_direction(sight: PinholeCamera, up: wp.vec3):
    """Return the direction to the key light, which turns with the camera, but only about the up axis."""
    level = wp.dot(sight.forward, up) * up - sight.forward
    if wp.length(level) < 1.0e-4:  # straight up or down
        level = -sight.up
    right = wp.normalize(sight.right)
    return wp.normalize(KEY_LIGHT[0] * right + KEY_LIGHT[1] * up + KEY_LIGHT[2] * wp.normalize(level))


@wp.kernel
def show_colors(
    mask: wp.array[wp.int32],
    sights: wp.array[PinholeCamera],
    up: wp.vec3,
    corners: wp.array[wp.vec3i],
    points: wp.array2d[wp.vec3],
    colors: wp.array[wp.vec3],
    first: wp.int32,
    keys: wp.array3d[wp.int64],
    normals: wp.array3d[wp.vec3],
    # out
    picture: wp.array4d[wp.uint8],
):
    """Light the hits, without shadows, and turn them into sRGB bytes; a thread a (world, row, column).

    Args:
        colors: of all things, in order of their numbers, linear RGB; the first is the ground's.
    """
    world, row, column = wp.tid()
    if not is_chosen(mask, world):
        return
    sight = sights[world]
    key = keys[world, row, column]
    x = 2.0 * (float(column) + 0.5) / float(keys.shape[2]) - 1.0
    y = 1.0 - 2.0 * (float(row) + 0.5) / float(keys.shape[1])
    light = backdrop(y, x)
    if wp.isfinite(depth_of(key)):
        number = number_of(key)
        normal = normals[world, row, column]
        if number >= first:
            p = corners[number - first]
            a = points[world, p[0]]
            normal = wp.normalize(wp.cross(points[world, p[1]] - a, points[world, p[2]] - a))
            if wp.dot(normal, ray_of(sight, row, column, keys.shape[1], keys.shape[2])) > 0.0:
                normal = -normal
        falling = wp.max(wp.dot(normal, key_direction(sight, up)), 0.0) * KEY_LIGHT_RADIANCE
        falling += sky_irradiance(wp.vec3(0.0, wp.dot(normal, up), 0.0), colors[0])
        light = wp.cw_mul(colors[number], falling)
    shown = tone(light)
    for channel in range(3):
        picture[world, row, column, channel] = srgb_byte(shown[channel])
