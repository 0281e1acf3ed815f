"""The studio: a backdrop, a gentle sky, a large key softbox and a strip light opposite, all infinitely far away."""

import warp as wp

KEY = (-0.62, 1.0, 0.62)
"""Direction to the key light: to the right, up, and back toward the camera"""
KEY_RADIANCE = (1.06, 1.02, 0.96)
"""Radiance that the key light adds to a white surface facing it"""


@wp.struct
class Studio:
    """Lights of the studio. Directions are unit vectors toward the light; Y is up."""

    key: wp.vec3
    """Direction of the key softbox"""
    key_right: wp.vec3
    key_up: wp.vec3
    rim: wp.vec3
    """Direction of the strip light"""
    rim_right: wp.vec3
    rim_up: wp.vec3
    key_radiance: wp.vec3
    """Radiance that the key light adds to a white surface facing it"""
    paper: wp.vec3
    """Tint of the backdrop"""
    key_spread: float
    """Tangent of the half angle of the key light, for soft shadows"""


@wp.func
def mix(a: wp.vec3, b: wp.vec3, t: float):
    """Interpolate linearly from a at 0 to b at 1."""
    return a + t * (b - a)


@wp.func
def luminance(color: wp.vec3):
    """Return the luminance of a color, by Rec. 709 weights."""
    return wp.dot(color, wp.vec3(0.2126, 0.7152, 0.0722))


@wp.func
def backdrop(height: float, across: float):
    """Return the light of the backdrop, a warm paper sweep.

    Both arguments run from -1 to 1 over the picture.
    """
    light = mix(wp.vec3(0.90, 0.86, 0.80), wp.vec3(0.86, 0.83, 0.80), wp.smoothstep(-0.6, 1.3, height))
    corner = across * across + 0.6 * height * height
    return light * (1.0 - 0.12 * wp.smoothstep(0.2, 1.8, corner))


@wp.func
def sky_irradiance(normal: wp.vec3, ground_color: wp.vec3):
    """Return the diffuse light from all around, softboxes apart, on a surface that nothing shadows."""
    from_sky = mix(wp.vec3(0.26, 0.27, 0.30), wp.vec3(0.36, 0.36, 0.36), 0.5 + 0.5 * normal[1])
    return mix(0.34 * ground_color, from_sky, wp.smoothstep(-1.0, 0.7, normal[1]))


@wp.func
def panel(direction: wp.vec3, toward: wp.vec3, right: wp.vec3, up: wp.vec3, half: wp.vec2, blur: float):
    """Return the visible fraction of a soft-edged rectangular light along a direction.

    `half` is its half size at distance one.
    """
    ahead = wp.dot(direction, toward)
    if ahead <= 0.05:
        return 0.0
    x = wp.abs(wp.dot(direction, right)) / ahead
    y = wp.abs(wp.dot(direction, up)) / ahead
    inside_x = 1.0 - wp.smoothstep(half[0] - blur, half[0] + blur, x)
    inside_y = 1.0 - wp.smoothstep(half[1] - blur, half[1] + blur, y)
    # A blurred light spreads its power over a larger area.
    return inside_x * inside_y * half[0] * half[1] / ((half[0] + 0.5 * blur) * (half[1] + 0.5 * blur))


@wp.func
def softbox(direction: wp.vec3, toward: wp.vec3, right: wp.vec3, up: wp.vec3, half: wp.vec2, blur: float):
    """Return the light of a softbox, brightest where its lamp is, with a bar across the middle of its frame."""
    light = panel(direction, toward, right, up, half, blur)
    if light > 0.0:
        ahead = wp.max(wp.dot(direction, toward), 0.05)
        x = wp.dot(direction, right) / (ahead * half[0])
        y = wp.dot(direction, up) / (ahead * half[1])
        bar = 0.035 / half[1]
        soft = bar + 1.5 * blur / half[1]
        across = 1.0 - bar / soft * (1.0 - wp.smoothstep(0.5 * soft, soft, wp.abs(y)))
        light *= across * (1.12 - 0.3 * wp.min(x * x + y * y, 1.5))
    return light


@wp.func
def mirrored_room(direction: wp.vec3, roughness: float, ground_color: wp.vec3):
    """Return the light that a surface of some roughness mirrors from a direction, without the lights.

    A floor that is bright near by, a wall that is dark where it meets the floor, and a large white cloth overhead.
    """
    soft = 0.04 + 0.6 * roughness
    floor = mix(0.45 * ground_color, 0.8 * ground_color, wp.smoothstep(-0.9, -0.1, direction[1]))
    wall = mix(wp.vec3(0.30, 0.29, 0.29), wp.vec3(0.62, 0.64, 0.68), wp.smoothstep(-0.05, 0.55, direction[1]))
    above = mix(wall, wp.vec3(1.25, 1.25, 1.25), wp.smoothstep(0.72 - soft, 0.72 + soft, direction[1]))
    return mix(floor, above, wp.smoothstep(-soft, soft, direction[1]))


@wp.func
def mirrored_lights(studio: Studio, direction: wp.vec3, roughness: float):
    """Return the light that a surface of some roughness mirrors of the two lights."""
    blur = 0.03 + 0.9 * roughness * roughness
    key = softbox(direction, studio.key, studio.key_right, studio.key_up, wp.vec2(0.34, 0.44), blur)
    rim = panel(direction, studio.rim, studio.rim_right, studio.rim_up, wp.vec2(0.14, 0.70), blur)
    return key * wp.vec3(28.0, 27.4, 26.4) + rim * wp.vec3(8.0, 8.3, 8.8)
