"""Response of surfaces to the studio's light: rubber, prints, shadows.

Light in a thin wall of dyed rubber.

A wall of thickness one looks like a party balloon's.
"""

import warp as wp

from balloon_warp.kernels.pictures.shapes import GROUND, NOTHING, SURFACE, Hit, Shapes, first_hit
from balloon_warp.kernels.pictures.studio import Studio, luminance, mirrored_lights, mirrored_room, mix, sky_irradiance

USUAL = wp.constant(0.08)
"""Transparency, one less the material's opacity, of an unstretched wall of thickness one"""
CLOUDY = wp.constant(0.8)
"""Exponent of scattering for a wall of thickness one, which scatters all but exp(-CLOUDY) of the light"""
DYED = wp.constant(0.56)
"""Power of its color that a wall of thickness one transmits: two such walls show about the color itself"""
PALER = wp.constant(0.6)
"""Power of the thickness that shows"""
DEEPEST = wp.constant(3.4)
"""Relative path length through a wall at the silhouette, seen edge-on"""


@wp.struct
class Wall:
    """Shares of the light, by color."""

    clear: wp.vec3
    """Fraction of the light that passes unscattered"""
    back: wp.vec3
    """Fraction of the light that is scattered back"""
    forth: wp.vec3
    """Fraction of the light that is scattered to the other side"""


@wp.func
def thickness_of(opacity: float, shrunk: float):
    """Return the thickness of a wall: it grows with the material's opacity, and falls with stretch.

    Args:
        shrunk: Area before over area now. Rubber keeps its volume, so that it is the thickness, too. Its power is a
            matter of looks: walls stretched fourfold both ways would hardly be seen.
    """
    return wp.pow(shrunk, PALER) * USUAL / wp.max(1.0 - opacity, 1.0e-6)


@wp.func
def dyed(color: wp.vec3, power: float):
    """Return a color to a power, as in Beer and Lambert's law.

    A color without one component still lets a little of it through.
    """
    return wp.vec3(
        wp.pow(wp.clamp(color[0], 0.02, 1.0), power),
        wp.pow(wp.clamp(color[1], 0.02, 1.0), power),
        wp.pow(wp.clamp(color[2], 0.02, 1.0), power),
    )


@wp.func
def wall_of(color: wp.vec3, thickness: float, facing: float):
    """Return a wall that light meets under an angle.

    Args:
        facing: the angle's cosine; the way through is the longer, the smaller it is.
    """
    path = thickness / (facing + (1.0 - facing) / DEEPEST)
    clear = wp.exp(-CLOUDY * path)
    through = dyed(color, wp.min(DYED * path, 2.2))
    # Light that comes back has met less and less of a thick wall: the rest is the color of the dye.
    forth = (1.0 - clear) / (1.0 + path)
    wall = Wall()
    wall.clear = clear * through
    wall.forth = forth * through
    wall.back = (1.0 - clear - forth) * dyed(color, wp.min(0.55 + 0.4 * path, 1.35))
    return wall


@wp.func
def passes(wall: Wall):
    """Return the share of light that gets through, scattered or not."""
    return wall.clear + wall.forth


@wp.func
def glow(wall: Wall, key_radiance: wp.vec3):
    """Return the uniform light inside a balloon on its wall, from multiple scattering."""
    entered = wp.cw_mul(passes(wall), 0.5 * key_radiance + wp.vec3(0.6))
    return entered + wp.cw_mul(entered, wall.back)


FAR = wp.constant(1.0e4)
EPSILON = wp.constant(1.0e-3)
"""Offset of rays from a surface, in sizes of the action"""
MURK = wp.constant(0.3)
"""Fraction of the light that water reflects diffusely"""
REACH = wp.constant(0.7)
"""Range of ambient occlusion"""
WALLS = wp.constant(4)
"""Largest number of rubber walls that shadow rays pass"""


@wp.struct
class Answer:
    """Light that a surface sends to the viewer."""

    key: wp.vec3
    """Light from the key, unshadowed"""
    sky: wp.vec3
    """Light from the sky, unoccluded"""
    lights: wp.vec3
    """Mirror images of the lights"""
    through: wp.vec3
    """Share, by color, of the light behind the surface, or of its mirror image"""
    mirrors: wp.bool
    """Whether the ray goes on by mirror reflection"""


@wp.func
def ground_fade(point: wp.vec3):
    """Return the fraction of the backdrop in the ground's color: a studio's paper sweep has no horizon."""
    return wp.smoothstep(1.0, 6.0, wp.sqrt(point[0] * point[0] + point[2] * point[2]))


@wp.func
def ground_answer(hit: Hit, studio: Studio):
    """Return the response of the matte ground."""
    answer = Answer()
    answer.key = wp.max(wp.dot(hit.normal, studio.key), 0.0) * wp.cw_mul(hit.color, studio.key_radiance)
    answer.sky = wp.cw_mul(hit.color, sky_irradiance(hit.normal, hit.color))
    return answer


@wp.func
def water_answer(hit: Hit, studio: Studio, direction: wp.vec3, ground_color: wp.vec3):
    """Return the response of water: clear from above, a mirror at grazing angles, a little murky, so that shadows show.

    Args:
        direction: of the ray that hit.
    """
    facing = -wp.dot(hit.normal, direction)
    # Schlick's approximation for an index of 1.33, held back, or the room would hide things under water.
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
    """Return the response of a line: an even color, since it is too thin for shading."""
    facing = wp.abs(wp.dot(hit.normal, direction))
    light = 0.5 * studio.key_radiance + sky_irradiance(hit.normal, ground_color)
    answer = Answer()
    answer.lights = (0.6 + 0.4 * facing) * wp.cw_mul(hit.color, light)
    return answer


@wp.func
def is_film(hit: Hit):
    """Return whether a hit is a translucent wall."""
    return hit.kind == SURFACE and hit.finish[1] < 1.0 and hit.finish[3] == 0.0


@wp.func
def film_at(hit: Hit, direction: wp.vec3):
    """Return the wall that a ray has hit."""
    thickness = thickness_of(hit.finish[1], hit.shrunk)
    return wall_of(hit.color, thickness, wp.abs(wp.dot(hit.normal, direction)))


@wp.func
def film_answer(hit: Hit, studio: Studio, direction: wp.vec3, ground_color: wp.vec3, inside: wp.bool):
    """Return the response of a wall of dyed rubber with light on both sides.

    Args:
        direction: of the ray that hit.
        inside: whether it came from within the balloon.
    """
    answer = Answer()
    wall = film_at(hit, direction)
    shut = glow(wall, studio.key_radiance)
    toward_key = wp.dot(hit.normal, studio.key)
    front, behind = wp.max(toward_key, 0.0), wp.max(-toward_key, 0.0)
    if inside:
        came_in = front * wp.cw_mul(wall.back, passes(wall)) + behind * wall.forth
        answer.key = wp.cw_mul(came_in, studio.key_radiance)
        answer.sky = wp.cw_mul(wall.forth, sky_irradiance(-hit.normal, ground_color)) + wp.cw_mul(wall.back, shut)
    else:
        # Light from behind has crossed the far wall, too: the shadow's ray finds its share.
        answer.key = wp.cw_mul(front * wall.back + behind * wall.forth, studio.key_radiance)
        answer.sky = wp.cw_mul(wall.back, sky_irradiance(hit.normal, ground_color)) + wp.cw_mul(wall.forth, shut)
    answer.through = wall.clear
    return answer


@wp.func
def metal_answer(hit: Hit, studio: Studio, direction: wp.vec3, ground_color: wp.vec3):
    """Return the response of a tinted mirror, which is a little dull."""
    answer = Answer()
    grazing = 1.0 + wp.dot(hit.normal, direction)
    dull = 0.1 * hit.color
    answer.key = wp.max(wp.dot(hit.normal, studio.key), 0.0) * wp.cw_mul(dull, studio.key_radiance)
    answer.sky = wp.cw_mul(dull, sky_irradiance(hit.normal, ground_color))
    answer.through = 0.9 * mix(hit.color, wp.vec3(1.0), wp.pow(grazing, 5.0))
    answer.mirrors = True
    return answer


@wp.func
def surface_answer(hit: Hit, studio: Studio, direction: wp.vec3, ground_color: wp.vec3, inside: wp.bool):
    """Return the response of a dyed body under a clear gloss, a thin wall of rubber under one, or metal.

    Args:
        direction: of the ray that hit.
        inside: whether it came from within a balloon.
    """
    answer = Answer()
    if hit.finish[3] > 0.0:
        answer = metal_answer(hit, studio, direction, ground_color)
    else:
        facing = -wp.dot(hit.normal, direction)
        # Schlick's approximation for an index of 1.5, held back where it would outline the silhouette.
        fresnel = 0.04 + 0.5 * wp.pow(1.0 - facing, 5.0)
        gloss = fresnel * wp.max(hit.finish[2], 1.0 - hit.finish[0])
        if is_film(hit):
            answer = film_answer(hit, studio, direction, ground_color, inside)
            answer.through *= 1.0 - fresnel
            gloss *= wp.where(inside, 0.5 * luminance(answer.through) + 0.1, 1.0)
        else:
            answer.key = wp.max(wp.dot(hit.normal, studio.key), 0.0) * wp.cw_mul(hit.color, studio.key_radiance)
            answer.sky = wp.cw_mul(hit.color, sky_irradiance(hit.normal, ground_color))
        roughness = hit.finish[0] * (1.0 - 0.9 * hit.finish[2])
        mirrored = direction + 2.0 * facing * hit.normal
        answer.key *= 1.0 - fresnel
        answer.sky = (1.0 - fresnel) * answer.sky + gloss * mirrored_room(mirrored, roughness, ground_color)
        answer.lights = gloss * mirrored_lights(studio, mirrored, roughness)
    return answer


@wp.func
def key_share(shapes: Shapes, studio: Studio, hit: Hit, disc: wp.vec2):
    """Return the share of the key light, by color, that arrives from one point of it, on the side facing it."""
    across = studio.key_spread * (disc[0] * studio.key_right + disc[1] * studio.key_up)
    direction = wp.normalize(studio.key + across)
    side = wp.where(wp.dot(hit.normal, studio.key) < 0.0, -EPSILON, EPSILON)
    origin = hit.point + side * hit.normal
    share = wp.vec3(1.0)
    walls = wp.int32(0)
    while walls < WALLS:
        blocker = first_hit(shapes, origin, direction, FAR)
        if blocker.kind == NOTHING:
            return share
        if not is_film(blocker):
            return wp.vec3(0.0)
        share = wp.cw_mul(share, passes(film_at(blocker, direction)))
        origin = blocker.point + EPSILON * direction
        walls += 1
    return share


@wp.func
def tangent_frame(normal: wp.vec3):
    """Return two unit vectors across a unit vector."""
    helper = wp.where(wp.abs(normal[1]) < 0.9, wp.vec3(0.0, 1.0, 0.0), wp.vec3(1.0, 0.0, 0.0))
    right = wp.normalize(wp.cross(helper, normal))
    return right, wp.cross(normal, right)


@wp.func
def sky_share(shapes: Shapes, hit: Hit, disc: wp.vec2):
    """Return the share of the sky's light, by color, along one direction.

    A surface there adds some of its own color.
    """
    right, forward = tangent_frame(hit.normal)
    up = wp.sqrt(wp.max(1.0 - wp.dot(disc, disc), 0.0))
    direction = wp.normalize(disc[0] * right + disc[1] * forward + up * hit.normal)
    blocker = first_hit(shapes, hit.point + EPSILON * hit.normal, direction, REACH)
    if blocker.kind == NOTHING:
        return wp.vec3(1.0)
    bounce = 0.45 * blocker.color
    if blocker.kind == GROUND:
        bounce = 0.35 * blocker.color
    elif is_film(blocker):
        bounce += 0.35 * passes(film_at(blocker, direction))
    return mix(bounce, wp.vec3(1.0), blocker.distance / REACH)
