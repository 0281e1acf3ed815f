"""Cameras that look into many worlds at once, by a ray through the middle of each pixel.

Such pictures are small and many, and all that they show moves in every frame. So each triangle finds the rays that hit
it, which needs no tree. The first hit of a ray is the least of keys, see `pictures.sights`. A mask chooses the worlds
that are looked at; one without entries chooses all.
"""

import warp as wp

from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.pictures.film import srgb_byte, tone
from balloon_warp.kernels.pictures.sights import Sight, depth_of, key_of, number_of, ray_of
from balloon_warp.kernels.pictures.studio import KEY, KEY_RADIANCE, backdrop, sky_irradiance
from balloon_warp.kernels.tables import is_chosen

wp.set_module_options(OPTIONS)

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
def see_triangles(
    mask: wp.array[wp.int32],
    sights: wp.array[Sight],
    corners: wp.array[wp.vec3i],
    faces: wp.array[wp.int32],
    torn: wp.array2d[float],
    points: wp.array2d[wp.vec3],
    first: wp.int32,
    # in and out
    keys: wp.array3d[wp.int64],
):
    """Put triangles where they are nearer than earlier hits, but for torn ones; a thread a (world, triangle).

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
def tell_depths(mask: wp.array[wp.int32], keys: wp.array3d[wp.int64], depths: wp.array3d[float]):
    """Tell depths from keys; a thread a (world, row, column)."""
    world, row, column = wp.tid()
    if not is_chosen(mask, world):
        return
    depths[world, row, column] = depth_of(keys[world, row, column])


@wp.func
def key_direction(sight: Sight, up: wp.vec3):
    """Return the direction to the key light, which turns with the camera, but only about the up axis."""
    level = wp.dot(sight.forward, up) * up - sight.forward
    if wp.length(level) < 1.0e-4:  # straight up or down
        level = -sight.up
    right = wp.normalize(sight.right)
    return wp.normalize(KEY_LIGHT[0] * right + KEY_LIGHT[1] * up + KEY_LIGHT[2] * wp.normalize(level))


@wp.kernel
def show_colors(
    mask: wp.array[wp.int32],
    sights: wp.array[Sight],
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
