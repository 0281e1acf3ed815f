"""Light in a thin wall of dyed rubber.

A wall of thickness one looks like a party balloon's.
"""

import warp as wp

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
