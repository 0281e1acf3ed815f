"""Contact with spheres and with the ground (paper, "Collision Detection and Resolution").

A particle inside a sphere moves out along center -> particle. Its velocity into the sphere is taken away too: the paper
leaves it, but then a particle pressed against a sphere gathers speed for as long as it is pressed.

The sphere gets a force against that movement, proportional to how inflated the balloon is: the particle's own inflation
force times the sphere's `penalty`, so that the sphere feels pressure times contact area. The particle's momentum into
the sphere is lost, and the sphere's comes from nowhere. This is `contact = "penalty"`; the other is `laws.impulse`.
"""

import warp as wp

from balloon_warp.kernels.algebra import inverse_root, squared_length
from balloon_warp.kernels.laws.law import TINY, Parameter


@wp.func
def way_out(point: wp.vec3, center: wp.vec3, up: wp.vec3):
    """Return the direction from a sphere's center to a particle, a unit vector; up where they coincide."""
    arm = point - center
    if wp.length_sq(arm) > 0.0:
        return inverse_root(squared_length(arm)) * arm
    return up


@wp.func
def without_approach(velocity: wp.vec3, obstacle_velocity: wp.vec3, normal: wp.vec3):
    """Return the velocity without its component into the obstacle."""
    return velocity - wp.min(wp.dot(velocity - obstacle_velocity, normal), 0.0) * normal


@wp.func
def stopped_in_step(approach: float, depth: float, step_seconds: float):
    """Return how much of an approach a step stops [m/s]: as much as has led behind the surface, depth over step.

    The rest is stopped in the next step. So the impulse goes with the time of the contact, and does not jump where that
    moves to another step: derivatives by the causes of that are those of a bounce.
    """
    return wp.max(wp.min(approach, depth / step_seconds), 0.0)


@wp.func
def leave_sphere(
    point: wp.vec3,
    velocity: wp.vec3,
    center: wp.vec3,
    sphere_velocity: wp.vec3,
    radius: float,
    up: wp.vec3,
    step_seconds: float,
):
    """Move a particle out of a sphere, and stop its approach, see `stopped_in_step`.

    Returns its point, its velocity, and the unit vector along which it moved, zero if it is outside.
    """
    outward = wp.vec3()
    if wp.length_sq(point - center) < radius * radius:
        outward = way_out(point, center, up)
        depth = radius - wp.dot(point - center, outward)
        approach = -wp.dot(velocity - sphere_velocity, outward)
        point = center + radius * outward
        velocity += stopped_in_step(approach, depth, step_seconds) * outward
    return point, velocity, outward


@wp.func
def stand_on(
    point: wp.vec3,
    place: wp.vec3,
    velocity: wp.vec3,
    surface_velocity: wp.vec3,
    normal: wp.vec3,
    friction: float,
    step_seconds: float,
    at_once: bool,
    part: float,
):
    """Place [m] and velocity [m/s] of a particle that a step has brought to a point behind a surface.

    Its approach is stopped by `stopped_in_step`, or at once.

    By Coulomb's law friction stops at most `friction` times as much of the tangential part. The way along the surface
    is that of the velocity once all is stopped: a particle goes as far as in a single contact, and a held one does not
    creep.

    Args:
        place: where the surface lets the particle go.
        at_once: whether all of the approach is stopped in this step: where one surface pushes it into another, or it
            slides past an edge, and there may be no surface in the next.
        part: of the step in which it slides along the surface, if so.
    """
    beside = velocity - surface_velocity
    approach = wp.max(-wp.dot(beside, normal), 0.0)
    stopped = approach
    slid = part
    if not at_once:
        stopped = stopped_in_step(approach, wp.dot(place - point, normal), step_seconds)
        slid = stopped / wp.max(approach, TINY)
    along = beside - wp.dot(beside, normal) * normal
    rubbed = friction * inverse_root(squared_length(along))
    slowed = velocity - wp.min(rubbed * stopped, 1.0) * along + stopped * normal
    return place - (slid * step_seconds * wp.min(rubbed * approach, 1.0)) * along, slowed


@wp.func
def leave_ground(
    point: wp.vec3, velocity: wp.vec3, up: wp.vec3, height: float, friction: float, step_seconds: float, at_once: bool
):
    """Move a particle up to the ground's height, and slow it, see `stand_on`."""
    depth = height - wp.dot(point, up)
    if depth > 0.0:
        place = point + depth * up
        stood, slowed = stand_on(point, place, velocity, wp.vec3(), up, friction, step_seconds, at_once, 1.0)
        point = stood
        velocity = slowed
    return point, velocity


@wp.func
def out_of_sphere(point: wp.vec3, normal: wp.vec3, center: wp.vec3, radius: float, up: wp.vec3):
    """Project a point out of a sphere, and return it with the contact normal; unchanged if it is outside."""
    if wp.length_sq(point - center) < radius * radius:
        normal = way_out(point, center, up)
        point = center + radius * normal
    return point, normal


@wp.func
def penalty_force(penalty: float, inflation: wp.vec3, outward: wp.vec3):
    """Force on a sphere [N] from a particle that it moved `outward`."""
    squared = squared_length(inflation)
    return (-penalty * squared * inverse_root(squared)) * outward


@wp.func
def stop_of(coming: float, depth: float, before: float, restitution: float, step_seconds: float):
    """Return the change of a sphere's speed along the normal of the surface that it meets in a step [m/s].

    It goes as far as the surface or, if it came, turns where it is, with the speed that it had before the step times
    the restitution. So no energy is gained, and with restitution 1 the invariant of symplectic Euler stays, whatever
    the step: v^2 / 2 + a g + a h v / 2 of a sphere that is g away, comes at v, and is pulled by a.

    Args:
        coming: How fast it comes after the step's forces [m/s].
        depth: How far it would be behind the surface after the step [m].
        before: How fast it came before these forces [m/s].
    """
    stopped = float(0.0)
    excess = wp.min(depth / step_seconds, coming)
    if excess > 0.0:
        stopped = wp.max(excess, coming + restitution * before)
    return stopped


AS_OTHERS = -1.0
"""Marker: a balloon without a friction coefficient of its own"""
FRICTION = Parameter(
    "balloon_friction",
    "1",
    AS_OTHERS,
    least=0.0,
    path="friction",
    meaning="Coulomb friction coefficient; a contact takes the geometric mean of both. When missing, the "
    "other thing's coefficient counts alone, and between balloons `touch.friction`",
)
NO_GROUND = -1.0e30
"""Marker: ground height of a scene without ground [m]"""
SPHERE = (
    Parameter("sphere_mass", "kg", 1.0, least=TINY, of="sphere", path="mass"),
    Parameter("sphere_radius", "m", 0.15, least=TINY, of="sphere", path="radius"),
    Parameter("sphere_penalty", "1", 1.0, least=0.0, of="sphere", path="penalty"),
    Parameter("sphere_restitution", "1", 0.3, least=0.0, most=1.0, of="sphere", path="restitution"),
    Parameter("sphere_friction", "1", 0.0, least=0.0, of="sphere", path="friction"),
)
"""Parameters of spheres, in the order of their columns"""
GROUND = (
    Parameter("ground_height", "m", of="world", path="ground.height", absent=NO_GROUND, meaning="Height of the ground"),
    Parameter(
        "ground_friction",
        "1",
        0.5,
        least=0.0,
        of="world",
        path="ground.friction",
        meaning="Coulomb friction coefficient",
    ),
    Parameter(
        "ground_restitution",
        "1",
        0.3,
        least=0.0,
        most=1.0,
        of="world",
        path="ground.restitution",
        meaning="Coefficient of restitution for spheres",
    ),
)
