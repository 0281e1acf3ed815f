"""The ray caster: one thread a pixel, three passes.

1. `cast_pixels` adds up a pixel's samples. It keeps what the key light and the sky would add if nothing stood in their
   way apart from how much of each gets there, which is what few samples make noisy.
2. `smooth_light` blurs those two shares over neighbors that lie on the same surface, rows first, then columns.
3. `develop` puts the light together and turns it into the bytes of an sRGB picture.

Rows are dealt out to bands, so that CPU threads can share a picture: a band's thread `row` stands for the picture's row
`band + row * band_count`.
"""

import warp as wp

from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.pictures.film import srgb_byte, tone
from balloon_warp.kernels.pictures.shapes import GROUND, LINE, NOTHING, SURFACE, Hit, Shapes, first_hit, water_before
from balloon_warp.kernels.pictures.studio import Studio, backdrop, luminance
from balloon_warp.kernels.pictures.surface import (
    EPSILON,
    FAR,
    Answer,
    ground_answer,
    ground_fade,
    key_share,
    line_answer,
    sky_share,
    surface_answer,
    water_answer,
)

wp.set_module_options({**OPTIONS, "enable_backward": False, "fast_math": True})

LAYERS = wp.constant(3)
"""how many translucent walls one looks through"""


@wp.struct
class Camera:
    """A pinhole. `right` and `up` reach from the middle of the picture to its edges at distance one."""

    eye: wp.vec3
    forward: wp.vec3
    right: wp.vec3
    up: wp.vec3


@wp.func
def with_one(share: wp.vec3):
    """A share and its weight, to be summed."""
    return wp.vec4(share[0], share[1], share[2], 1.0)


@wp.func
def mean_share(summed: wp.vec4):
    """The share from a weighted sum of shares and weights."""
    return wp.vec3(summed[0], summed[1], summed[2]) / wp.max(summed[3], 1.0e-9)


@wp.func
def answer_of(hit: Hit, studio: Studio, direction: wp.vec3, ground_color: wp.vec3):
    """What a thing of any kind does with the light."""
    answer = Answer()
    if hit.kind == SURFACE:
        answer = surface_answer(hit, studio, direction, ground_color)
    elif hit.kind == LINE:
        answer = line_answer(hit, studio, direction, ground_color)
    elif hit.kind == GROUND:
        answer = ground_answer(hit, studio)
    else:
        answer = water_answer(hit, studio, direction, ground_color)
    return answer


@wp.kernel
def cast_pixels(
    shapes: Shapes,
    studio: Studio,
    camera: Camera,
    pixel_samples: wp.array[wp.vec2],
    disc_samples: wp.array2d[wp.vec2],
    band: int,
    band_count: int,
    # out
    plain: wp.array2d[wp.vec3],
    key_light: wp.array2d[wp.vec3],
    sky_light: wp.array2d[wp.vec3],
    key_shares: wp.array2d[wp.vec4],
    sky_shares: wp.array2d[wp.vec4],
    places: wp.array2d[wp.vec3],
    normals: wp.array2d[wp.vec3],
):
    """A thread a (row of the band, column)."""
    band_row, column = wp.tid()
    row = band + band_row * band_count
    height = places.shape[0]
    width = places.shape[1]
    tile = 4 * (row % 4) + column % 4
    sum_plain = wp.vec3()
    sum_key = wp.vec3()
    sum_sky = wp.vec3()
    sum_key_share = wp.vec4()
    sum_sky_share = wp.vec4()
    for sample in range(pixel_samples.shape[0]):
        offset = pixel_samples[sample]
        x = 2.0 * (float(column) + offset[0]) / float(width) - 1.0
        y = 1.0 - 2.0 * (float(row) + offset[1]) / float(height)
        direction = wp.normalize(camera.forward + x * camera.right + y * camera.up)
        behind = backdrop(y, x)
        disc = disc_samples[sample, tile]
        origin = camera.eye
        weight = wp.vec3(1.0)
        layer = wp.int32(0)
        while layer < LAYERS:
            hit = water_before(shapes, origin, direction, first_hit(shapes, origin, direction, FAR))
            if sample == 0 and layer == 0:
                places[row, column] = hit.point
                normals[row, column] = hit.normal
            if hit.kind == NOTHING:
                sum_plain += wp.cw_mul(weight, behind)
                break
            answer = answer_of(hit, studio, direction, shapes.ground_color)
            if hit.kind != SURFACE and hit.kind != LINE:
                fade = ground_fade(hit.point)
                sum_plain += fade * wp.cw_mul(weight, behind)
                weight *= 1.0 - fade
            key = wp.cw_mul(weight, answer.key)
            sky = wp.cw_mul(weight, answer.sky)
            sum_plain += wp.cw_mul(weight, answer.lights)
            if layer == 0:
                sum_key += key
                sum_sky += sky
                bright = luminance(key)
                if bright > 1.0e-4:
                    sum_key_share += bright * with_one(key_share(shapes, studio, hit, disc))
                bright = luminance(sky)
                if bright > 1.0e-4:
                    sum_sky_share += bright * with_one(sky_share(shapes, hit, disc))
            else:
                # Behind a wall nobody will miss a shadow: what is there gets a share of the light.
                sum_plain += 0.7 * sky + 0.4 * key
            weight = wp.cw_mul(weight, answer.through)
            if luminance(weight) < 0.03:
                break
            origin = hit.point + EPSILON * direction
            layer += 1
    scale = 1.0 / float(pixel_samples.shape[0])
    plain[row, column] = scale * sum_plain
    key_light[row, column] = scale * sum_key
    sky_light[row, column] = scale * sum_sky
    key_shares[row, column] = scale * sum_key_share
    sky_shares[row, column] = scale * sum_sky_share


@wp.kernel
def smooth_light(
    key_shares: wp.array2d[wp.vec4],
    sky_shares: wp.array2d[wp.vec4],
    places: wp.array2d[wp.vec3],
    normals: wp.array2d[wp.vec3],
    radius: int,
    row_step: int,
    column_step: int,
    band: int,
    band_count: int,
    # out
    smooth_key: wp.array2d[wp.vec4],
    smooth_sky: wp.array2d[wp.vec4],
):
    """A thread a (row of the band, column): a Gaussian along rows or columns over pixels of the same surface."""
    band_row, column = wp.tid()
    row = band + band_row * band_count
    sum_key = key_shares[row, column]
    sum_sky = sky_shares[row, column]
    normal = normals[row, column]
    # Pixels that a translucent or a lit thing touches have some light; the backdrop has none.
    if sum_key[3] + sum_sky[3] > 0.0:
        place = places[row, column]
        falloff = -2.0 / float(radius * radius)
        for step in range(-radius, radius + 1):
            other_row = row + step * row_step
            other_column = column + step * column_step
            inside = other_row >= 0 and other_row < places.shape[0] and other_column >= 0
            if step != 0 and inside and other_column < places.shape[1]:
                alike = wp.max(wp.dot(normal, normals[other_row, other_column]), 0.0)
                alike *= alike
                alike *= alike
                off_plane = wp.abs(wp.dot(normal, places[other_row, other_column] - place))
                weight = alike * alike * wp.exp(falloff * float(step * step) - 80.0 * off_plane)
                sum_key += weight * key_shares[other_row, other_column]
                sum_sky += weight * sky_shares[other_row, other_column]
    smooth_key[row, column] = sum_key
    smooth_sky[row, column] = sum_sky


@wp.kernel
def develop(
    plain: wp.array2d[wp.vec3],
    key_light: wp.array2d[wp.vec3],
    sky_light: wp.array2d[wp.vec3],
    key_shares: wp.array2d[wp.vec4],
    sky_shares: wp.array2d[wp.vec4],
    band: int,
    band_count: int,
    # out
    picture: wp.array3d[wp.uint8],
):
    """A thread a (row of the band, column): light together, tone curve, sRGB bytes."""
    band_row, column = wp.tid()
    row = band + band_row * band_count
    light = plain[row, column]
    light += wp.cw_mul(key_light[row, column], mean_share(key_shares[row, column]))
    light += wp.cw_mul(sky_light[row, column], mean_share(sky_shares[row, column]))
    shown = tone(light)
    picture[row, column, 0] = srgb_byte(shown[0])
    picture[row, column, 1] = srgb_byte(shown[1])
    picture[row, column, 2] = srgb_byte(shown[2])
