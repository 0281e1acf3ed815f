"""Light along one ray: through walls of rubber and water, and by mirrors."""

import warp as wp

from balloon_warp.kernels.pictures.shapes import GROUND, LINE, NOTHING, SURFACE, Hit, Shapes, first_hit, water_before
from balloon_warp.kernels.pictures.studio import Studio, luminance, mirrored_lights, mirrored_room
from balloon_warp.kernels.pictures.surface import (
    EPSILON,
    FAR,
    Answer,
    ground_answer,
    ground_fade,
    is_film,
    key_share,
    line_answer,
    sky_share,
    surface_answer,
    water_answer,
)

LAYERS = wp.constant(3)
"""Largest number of walls and mirrors that a ray passes"""


@wp.struct
class Sight:
    """Light that comes along a ray."""

    plain: wp.vec3
    """Light without that of key and sky on the first surface"""
    key: wp.vec3
    """Light of the key on the first surface, unshadowed"""
    sky: wp.vec3
    """Light of the sky on the first surface, unoccluded"""
    key_share: wp.vec4
    """Weighted share of the key's light that arrives, and the weight"""
    sky_share: wp.vec4
    """Weighted share of the sky's light that arrives, and the weight"""
    backdrop: float
    """Share of the light that is the backdrop's"""
    place: wp.vec3
    """First surface point"""
    normal: wp.vec3
    caught: float
    """Share of the light that is the ground's, where the ground only catches shadows"""


@wp.func
def with_one(share: wp.vec3):
    """Return a share and its weight, to be summed."""
    return wp.vec4(share[0], share[1], share[2], 1.0)


@wp.func
def answer_of(hit: Hit, studio: Studio, direction: wp.vec3, ground_color: wp.vec3, inside: wp.bool):
    """Return the response of a surface to light, inside a balloon or outside."""
    answer = Answer()
    if hit.kind == SURFACE:
        answer = surface_answer(hit, studio, direction, ground_color, inside)
    elif hit.kind == LINE:
        answer = line_answer(hit, studio, direction, ground_color)
    elif hit.kind == GROUND:
        answer = ground_answer(hit, studio)
    else:
        answer = water_answer(hit, studio, direction, ground_color)
    return answer


@wp.func
def light_farther(hit: Hit, inside: wp.bool, weight: wp.vec3, key: wp.vec3, sky: wp.vec3):
    """Return the light on a surface that is seen through another.

    It gets a share of the light in place of shadows, which nobody misses there.
    """
    light = 0.9 * sky + 0.7 * key
    if is_film(hit):
        light = sky + 0.9 * key
    elif inside:
        # Light there has crossed the wall, too.
        light = wp.cw_mul(weight, 0.8 * sky + 0.7 * key)
    return light


@wp.func
def look_along(
    shapes: Shapes,
    studio: Studio,
    origin: wp.vec3,
    direction: wp.vec3,
    behind: wp.vec3,
    disc: wp.vec2,
    asks_key: wp.bool,
    asks_sky: wp.bool,
    catches: wp.bool,
):
    """Return the light along a ray.

    Args:
        behind: Light of the backdrop there.
        disc: Sample point on the lights and of the sky whose visibility is tested.
        asks_key, asks_sky: Whether to test their visibility.
        catches: Whether of the ground only shadows are seen, and those not through anything.
    """
    seen = Sight()
    start = origin
    along = direction
    far_light = behind
    backdrop = wp.float32(1.0)
    weight = wp.vec3(1.0)
    inside = wp.bool(False)
    layer = wp.int32(0)
    while layer < LAYERS:
        hit = water_before(shapes, start, along, first_hit(shapes, start, along, FAR))
        if layer == 0:
            seen.place = hit.point
            seen.normal = hit.normal
        # A mirror shows the ground all the same.
        clear_ground = catches and hit.kind == GROUND and backdrop > 0.0
        if hit.kind == NOTHING or (clear_ground and layer > 0):
            break
        answer = answer_of(hit, studio, along, shapes.ground_color, inside)
        if hit.kind != SURFACE and hit.kind != LINE:
            fade = ground_fade(hit.point)
            seen.plain += fade * wp.cw_mul(weight, far_light)
            seen.backdrop += fade * backdrop * luminance(weight)
            weight *= 1.0 - fade
            if clear_ground:
                seen.caught = luminance(weight)
        key = wp.cw_mul(weight, answer.key)
        sky = wp.cw_mul(weight, answer.sky)
        seen.plain += wp.cw_mul(weight, answer.lights)
        if layer == 0:
            seen.key = key
            seen.sky = sky
            bright = luminance(key)
            if asks_key and bright > 1.0e-4:
                seen.key_share = bright * with_one(key_share(shapes, studio, hit, disc))
            bright = luminance(sky)
            if asks_sky and bright > 1.0e-4:
                seen.sky_share = bright * with_one(sky_share(shapes, hit, disc))
        else:
            seen.plain += light_farther(hit, inside, weight, key, sky)
        weight = wp.cw_mul(weight, answer.through)
        if luminance(weight) < 0.02:
            return seen
        if answer.mirrors:
            along -= 2.0 * wp.dot(along, hit.normal) * hit.normal
            far_light = mirrored_room(along, hit.finish[0], shapes.ground_color)
            far_light += mirrored_lights(studio, along, hit.finish[0])
            backdrop = 0.0
            start = hit.point + EPSILON * hit.normal
        else:
            start = hit.point + EPSILON * along
            inside = inside != is_film(hit)
        layer += 1
    seen.plain += wp.cw_mul(weight, far_light)
    seen.backdrop += backdrop * luminance(weight)
    return seen
