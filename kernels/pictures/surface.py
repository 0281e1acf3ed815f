"""How surfaces answer the light that reaches them, and how much of it does."""

import warp as wp

from balloon_warp.kernels.pictures.shapes import GROUND, NOTHING, Hit, Shapes, first_hit
from balloon_warp.kernels.pictures.studio import Studio, mirrored_lights, mirrored_room, mix, sky_irradiance

FAR = wp.constant(1.0e4)
EPSILON = wp.constant(1.0e-3)
"""how far from a surface rays start, in sizes of the action"""
MURK = wp.constant(0.3)
"""the part of the light that water sends back"""
REACH = wp.constant(0.7)
"""how far away a thing can be that still dims the sky's light"""


@wp.struct
class Answer:
    """Light that a surface sends to the viewer."""

    key: wp.vec3
    """from the key light, where nothing shadows it"""
    sky: wp.vec3
    """from all around, where nothing is near"""
    lights: wp.vec3
    """mirror images of the lights"""
    through: wp.vec3
    """the share, by color, of what is behind it"""


@wp.func
def translucency(finish: wp.vec3):
    """How much a wall acts as thin rubber, 0 to 1, from its opacity."""
    return wp.clamp(8.0 * (1.0 - finish[1]), 0.0, 1.0)


@wp.func
def ground_fade(point: wp.vec3):
    """How far the ground has turned into the backdrop: a studio's paper sweep has no horizon."""
    return wp.smoothstep(1.0, 6.0, wp.sqrt(point[0] * point[0] + point[2] * point[2]))


@wp.func
def ground_answer(hit: Hit, studio: Studio):
    """Matte."""
    answer = Answer()
    answer.key = wp.max(wp.dot(hit.normal, studio.key), 0.0) * wp.cw_mul(hit.color, studio.key_radiance)
    answer.sky = wp.cw_mul(hit.color, sky_irradiance(hit.normal, hit.color))
    return answer


@wp.func
def water_answer(hit: Hit, studio: Studio, direction: wp.vec3, ground_color: wp.vec3):
    """Clear where one looks down on it, a mirror where one looks along it, and a little murky, so that shadows show.

    Args:
        direction: of the ray that hit.
    """
    facing = -wp.dot(hit.normal, direction)
    # Schlick's approximation for an index of 1.33, held back, or the room would hide what is under water.
    fresnel = 0.02 + 0.4 * wp.pow(1.0 - facing, 5.0)
    answer = Answer()
    answer.key = MURK * (1.0 - fresnel) * wp.max(wp.dot(hit.normal, studio.key), 0.0) * hit.color
    answer.key = wp.cw_mul(answer.key, studio.key_radiance)
    answer.sky = MURK * (1.0 - fresnel) * wp.cw_mul(hit.color, sky_irradiance(hit.normal, ground_color))
    answer.through = (1.0 - MURK) * (1.0 - fresnel) * mix(wp.vec3(1.0), hit.color, 0.2)
    mirrored = direction + 2.0 * facing * hit.normal
    answer.lights = fresnel * (mirrored_room(mirrored, 0.0, ground_color) + mirrored_lights(studio, mirrored, 0.0))
    return answer


@wp.func
def line_answer(hit: Hit, studio: Studio, direction: wp.vec3, ground_color: wp.vec3):
    """Too thin to show where its light comes from: an even color reads best."""
    facing = wp.abs(wp.dot(hit.normal, direction))
    light = 0.5 * studio.key_radiance + sky_irradiance(hit.normal, ground_color)
    answer = Answer()
    answer.lights = (0.6 + 0.4 * facing) * wp.cw_mul(hit.color, light)
    return answer


@wp.func
def surface_answer(hit: Hit, studio: Studio, direction: wp.vec3, ground_color: wp.vec3):
    """A dyed body under a clear gloss; with some opacity missing, a thin wall of rubber.

    Args:
        direction: of the ray that hit.
    """
    answer = Answer()
    rubber = translucency(hit.finish)
    facing = -wp.dot(hit.normal, direction)
    toward_key = wp.dot(hit.normal, studio.key)
    # Schlick's approximation for an index of 1.5, held back where the room's mirror image would outline the silhouette.
    fresnel = 0.04 + 0.5 * wp.pow(1.0 - facing, 5.0)
    # At the silhouette light has crossed more of the dyed rubber.
    dye = mix(hit.color, wp.cw_mul(hit.color, hit.color), 0.8 * rubber * (1.0 - facing) * (1.0 - facing))
    answer.key = wp.max(toward_key, 0.0) * wp.cw_mul(dye, studio.key_radiance)
    answer.sky = wp.cw_mul(dye, sky_irradiance(hit.normal, ground_color))
    # Light that entered the rubber elsewhere leaves it everywhere, most of it right opposite the key light.
    inner = rubber * (0.16 + 0.26 * wp.smoothstep(0.2, -1.0, toward_key))
    answer.sky += inner * wp.cw_mul(wp.cw_mul(dye, studio.key_radiance), mix(wp.vec3(1.0), dye, 0.4))
    seen_through = 0.55 * rubber * facing
    answer.through = seen_through * mix(wp.vec3(1.0), dye, 0.9)
    answer.key *= (1.0 - fresnel) * (1.0 - 0.5 * seen_through)
    answer.sky *= (1.0 - fresnel) * (1.0 - 0.5 * seen_through)
    gloss = fresnel * wp.max(hit.finish[2], 1.0 - hit.finish[0])
    roughness = hit.finish[0] * (1.0 - 0.9 * hit.finish[2])
    mirrored = direction + 2.0 * facing * hit.normal
    answer.sky += gloss * mirrored_room(mirrored, roughness, ground_color)
    answer.lights = gloss * mirrored_lights(studio, mirrored, roughness)
    return answer


@wp.func
def key_share(shapes: Shapes, studio: Studio, hit: Hit, disc: wp.vec2):
    """The share of the key light, by color, that comes through from one point of it."""
    across = studio.key_spread * (disc[0] * studio.key_right + disc[1] * studio.key_up)
    blocker = first_hit(shapes, hit.point + EPSILON * hit.normal, wp.normalize(studio.key + across), FAR)
    if blocker.kind == NOTHING:
        return wp.vec3(1.0)
    return 0.3 * translucency(blocker.finish) * blocker.color


@wp.func
def tangent_frame(normal: wp.vec3):
    """Two unit vectors across a unit vector."""
    helper = wp.where(wp.abs(normal[1]) < 0.9, wp.vec3(0.0, 1.0, 0.0), wp.vec3(1.0, 0.0, 0.0))
    right = wp.normalize(wp.cross(helper, normal))
    return right, wp.cross(normal, right)


@wp.func
def sky_share(shapes: Shapes, hit: Hit, disc: wp.vec2):
    """The share of the sky's light, by color, along one direction; what stands there adds some of its own color."""
    right, forward = tangent_frame(hit.normal)
    up = wp.sqrt(wp.max(1.0 - wp.dot(disc, disc), 0.0))
    direction = wp.normalize(disc[0] * right + disc[1] * forward + up * hit.normal)
    blocker = first_hit(shapes, hit.point + EPSILON * hit.normal, direction, REACH)
    if blocker.kind == NOTHING:
        return wp.vec3(1.0)
    bounce = 0.45 * blocker.color
    if blocker.kind == GROUND:
        bounce = 0.35 * blocker.color
    return mix(bounce, wp.vec3(1.0), blocker.distance / REACH)
