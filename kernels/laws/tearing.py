"""Rubber and film that tear: where a tear begins, the line along which it runs, and where it branches.

A tear begins where the larger principal true stress reaches the `strength`, or where a needle pierces. From face to
face it runs on where the stress ahead of its tip exceeds the `tear_strength`, at most as fast as waves on the surface
of the unstretched material, 0.955 root(mu / rho) (Rayleigh's, of an incompressible solid). Below a stress a balloon
opens along one tear; above it tears branch, and it bursts to pieces (Moulinet and Adda-Bedia 2015, Popping balloons: a
case study of dynamical fragmentation, PRL 115, 184301).

A tear is straight: it runs where a plane cuts the unstretched skin, at first across the largest tension. Only faces
that the plane cuts, ahead of a tip, can tear. Faces beside a tear bear as much until a wave reaches them, but a notch
concentrates no stress there. So a tear is a gap one face wide on any mesh. A torn face does not pull.
"""

import warp as wp

from balloon_warp.kernels.laws.law import FAR, TINY, Parameter

NEVER = 1.0e9
"""Time that is never reached [s]"""
RAYLEIGH = 0.955
"""Ratio of the speeds of Rayleigh waves and shear waves in an incompressible solid"""
TEARING, BRANCHING = 0.3, 0.5
"""Defaults, over the strength, of the stress ahead of a tear that it needs to advance, and of the stress above which it
branches"""
WHOLE = wp.constant(-1.0)
"""Marker: an intact face, in place of a tear's distance beyond it"""
TINY_LENGTH = wp.constant(1.0e-12)
"""Least length [m]"""
EVEN = wp.constant(0.05)
"""Difference of two squared stretches over their sum below which a tension has no direction"""
OPEN = wp.constant(0.25)
"""Area of a balloon's hole over its current surface area above which it no longer encloses gas"""
TEARING = (
    Parameter("film_strength", "Pa", FAR, least=TINY, path="material.strength"),
    Parameter("tear_strength", "Pa", float("nan"), least=TINY, path="material.tear_strength"),
    Parameter("branching_stress", "Pa", float("nan"), least=TINY, path="material.branching_stress"),
    Parameter("tear_speed", "m/s", float("nan"), least=TINY, path="material.tear_speed"),
    Parameter("needle_time", "s", NEVER, least=0.0, path="material.needle_time"),
)
"""Parameters of the balloon; NaN stands for a default that depends on other values"""


@wp.func
def true_stress(by_trace: float, by_det: float, major: float, minor: float):
    """Return the larger principal true stress l dW/dl [Pa], from slopes of the energy and squared stretches."""
    return 2.0 * major * (by_trace + by_det * minor)


@wp.func
def across_tension(first_rest: wp.vec3, second_rest: wp.vec3, first: wp.vec3, second: wp.vec3):
    """Return the direction of the larger stretch on the unstretched skin; that of the first edge where both are alike.

    Args:
        first_rest: two edges of a triangle, unstretched [m].
        first: the same now [m].
    """
    along = wp.normalize(first_rest)
    beside = second_rest - wp.dot(second_rest, along) * along
    first_slope = first / wp.length(first_rest)
    second_slope = (second - wp.dot(second_rest, along) * first_slope) / wp.max(wp.length(beside), TINY_LENGTH)
    larger = wp.length_sq(first_slope)
    other = wp.length_sq(second_slope)
    shear = 2.0 * wp.dot(first_slope, second_slope)
    direction = along
    if wp.length(wp.vec2(larger - other, shear)) > EVEN * (larger + other):
        angle = 0.5 * wp.atan2(shear, larger - other)
        direction = wp.cos(angle) * along + wp.sin(angle) * wp.normalize(beside)
    return direction


@wp.func
def plane_through(normal: wp.vec3, point: wp.vec3):
    """Return the plane through a point as its unit normal and its distance from the origin."""
    return wp.vec4(normal[0], normal[1], normal[2], wp.dot(normal, point))


@wp.func
def normal_of(plane: wp.vec4):
    """Read the unit normal of a plane."""
    return wp.vec3(plane[0], plane[1], plane[2])


@wp.func
def cuts(plane: wp.vec4, one: wp.vec3, other: wp.vec3):
    """Return whether a plane separates two points; a point on the plane counts as in front."""
    normal = normal_of(plane)
    return (wp.dot(normal, one) >= plane[3]) != (wp.dot(normal, other) >= plane[3])


@wp.func
def branch_plane(heading: wp.vec3, step: wp.vec3, face_normal: wp.vec3, point: wp.vec3):
    """Return the plane of a branch of a tear through a point, halfway between the tear's direction and a side.

    Args:
        heading: Unit vector along the other tear; zero where it begins.
        step: Direction to the side.
        face_normal: Normal of the skin there.
    """
    return plane_through(wp.normalize(wp.cross(face_normal, heading + wp.normalize(step))), point)
