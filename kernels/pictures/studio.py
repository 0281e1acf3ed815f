"""The studio: a backdrop, a gentle sky, a large key softbox and a strip light opposite, all infinitely far away."""

import warp as wp


@wp.struct
class Studio:
    """Where the lights are. Directions are unit vectors toward the light; Y is up."""

    key: wp.vec3
    """the key softbox"""
    key_right: wp.vec3
    key_up: wp.vec3
    rim: wp.vec3
    """the strip light"""
    rim_right: wp.vec3
    rim_up: wp.vec3
    key_radiance: wp.vec3
    """what the key light adds to a white surface that faces it"""
    key_spread: float
    """tangent of the half angle under which the key light casts soft shadows"""


@wp.func
def mix(a: wp.vec3, b: wp.vec3, t: float):
    """From a at 0 to b at 1."""
    return a + t * (b - a)


@wp.func
def luminance(color: wp.vec3):
    """Rec. 709 weights."""
    return wp.dot(color, wp.vec3(0.2126, 0.7152, 0.0722))


@wp.func
def backdrop(height: float, across: float):
    """What the camera sees behind everything: a warm paper sweep. Both arguments run from -1 to 1 over the picture."""
    light = mix(wp.vec3(0.90, 0.86, 0.80), wp.vec3(0.86, 0.83, 0.80), wp.smoothstep(-0.6, 1.3, height))
    corner = across * across + 0.6 * height * height
    return light * (1.0 - 0.12 * wp.smoothstep(0.2, 1.8, corner))


@wp.func
def sky_irradiance(normal: wp.vec3, ground_color: wp.vec3):
    """Diffuse light from all around, softboxes apart, on a surface that nothing shadows."""
    from_sky = mix(wp.vec3(0.26, 0.27, 0.30), wp.vec3(0.36, 0.36, 0.36), 0.5 + 0.5 * normal[1])
    return mix(0.34 * ground_color, from_sky, wp.smoothstep(-1.0, 0.7, normal[1]))


@wp.func
def panel(direction: wp.vec3, toward: wp.vec3, right: wp.vec3, up: wp.vec3, half: wp.vec2, blur: float):
    """How much of a soft-edged rectangular light is seen along a direction. `half` is its half size at distance one."""
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
def mirrored_room(direction: wp.vec3, roughness: float, ground_color: wp.vec3):
    """What a surface of some roughness mirrors from a direction, the lights apart."""
    floor = mix(0.34 * ground_color, 0.7 * ground_color, wp.smoothstep(-0.7, 0.0, direction[1]))
    sky = mix(wp.vec3(0.60, 0.59, 0.58), wp.vec3(0.85, 0.88, 0.92), wp.smoothstep(0.0, 0.9, direction[1]))
    soft = 0.12 + 0.5 * roughness
    return mix(floor, sky, wp.smoothstep(-soft, soft, direction[1]))


@wp.func
def mirrored_lights(studio: Studio, direction: wp.vec3, roughness: float):
    """What a surface of some roughness mirrors of the two lights."""
    blur = 0.07 + 0.9 * roughness * roughness
    key = panel(direction, studio.key, studio.key_right, studio.key_up, wp.vec2(0.30, 0.42), blur)
    rim = panel(direction, studio.rim, studio.rim_right, studio.rim_up, wp.vec2(0.14, 0.70), blur)
    return key * wp.vec3(30.0, 29.3, 28.2) + rim * wp.vec3(8.0, 8.3, 8.8)
