"""Contact with spheres, obstacles and the ground: Coulomb's friction, impulses, and spheres that collide.

Coulomb's friction as an impulse, which turns a sphere. With w the sphere's spin and r the arm from its center to where
it touches something, its surface slides there at

    s = u - (u . n) n,    u = V + w x r - (how fast the other moves there),

and an impulse against s stops as much of that as `friction` times the impulse P along n can:

    J = -min(|s| / e, friction P) s / |s|,    e = 1 / M + |r|^2 / I + (the same of the other),    I = 2/5 M R^2.

A sphere is solid, and nothing else brakes its spin. So one that is set down sliding slows down by friction g until it
rolls, at 5/7 of its speed; and down a slope it rolls with 5/7 g sin, unless that is steeper than 7/2 friction.

Particles that a sphere presses are many. Each gets k m |s| at most, see `laws.rigid`, with

    k = 1 / (1 + P e)    P the mass of all that are pressed, e the sphere's at that particle's arm:

then all of them together give no energy, since of two impulses on a sphere each shows at the other's place by no more
than the root of the product of both e. Impulses act where things meet: momentum and angular momentum stay.

Obstacles of prescribed motion have shapes as signed distances. The distance is that to the surface, negative inside,
less the obstacle's thickness; its gradient is the normal. A particle that a step has brought inside stands on the
surface where it came in, and is slowed as by the ground, see `resolve_at_surface`: so it begins to slide on a slope of
atan(friction), and slides with g (sin - friction cos). No energy is gained, but by the motion of an obstacle.

Distances of box and capsule: Quilez, *3D signed distance functions* (iquilezles.org, "distfunctions").

Spheres and ground (paper, "Collision Detection and Resolution"): a particle inside a sphere moves out along center ->
particle. Its velocity into the sphere is taken away too: the paper leaves it, but then a particle pressed against a
sphere gathers speed for as long as it is pressed.

The sphere gets a force against that movement, proportional to how inflated the balloon is: the particle's own inflation
force times the sphere's `penalty`, so that the sphere feels pressure times contact area. The particle's momentum into
the sphere is lost, and the sphere's comes from nowhere. This is `contact = "penalty"`; the other follows.

Contact that keeps momentum and gives no energy, of a body and the particles that it meets: `contact = "impulse"`. It
acts on velocities, before places follow them. A step h lets a particle with the gap g to a body, along the unit vector
n from the body, approach by g at most:

    n . (v_p' - V') >= -g / h

Particles and body take the velocities nearest to those without contact, measured by kinetic energy, at which that holds
for all particles (an inelastic contact). They exchange an impulse along n. So

- momentum stays, and angular momentum, since n passes through both at the step's start and places follow velocities;
- kinetic energy does not grow, whatever the step and the masses: the velocities that are allowed are a convex set which
  has rest in it, and the nearest of a convex set to a given vector is no longer than that;
- nothing is moved against springs: the particle goes to the surface, and not into the body and out again.

With a_p = -n . (v_p - V) - g / h, by how much a particle comes too fast, the body's velocity changes by the D of

    (M I + sum m n n^T) D = -sum m a_p n       over particles that it presses, those with n . D + a_p > 0

and each of those by (n . D + a_p) n. Which those are is found by solving again (Newton's method, of a convex function).
An overlap, at the start or since something else moved the particle, may not grow, and is resolved slowly, by mass, so
that the common center of mass stays, and without speed.

Collision of two spheres in a step: the time of impact, and the impulse. The one sees the other come from s by the way
w. They meet where |s + part w| is the sum R of their radii, along the unit vector n there. With u how fast the other
moves beside the one, an impulse along n makes

    n . u' = -e n . u    if they come nearer, e the restitution

and from there on they go at the new velocities. So momentum stays, and angular momentum, since n passes through both;
kinetic energy does not grow, as e <= 1, and neither does that of weight, which hangs on their common center of mass. At
any speed neither tunnels through the other: paths collide, not places.
"""

import warp as wp

from balloon_warp.kernels.algebra import inverse_root, squared_length
from balloon_warp.kernels.laws.law import TINY, Parameter

TURNING = wp.constant(2.5)
"""M R^2 / I of a solid ball"""


@wp.func
def friction_impulse(beside: wp.vec3, normal: wp.vec3, inverse_mass: float, most: float):
    """Return J [N s].

    Args:
        beside: u [m/s].
        inverse_mass: by how much 1 N s slows down the slip [1/kg].
        most: that friction can [N s].
    """
    sliding = beside - wp.dot(beside, normal) * normal
    speed = wp.length(sliding)
    impulse = wp.vec3()
    if speed > 0.0:
        impulse = (-wp.min(speed / inverse_mass, most) / speed) * sliding
    return impulse


@wp.func
def inverse_mass_of_ball(mass: float, radius: float, arm: wp.vec3):
    """Inverse effective mass of a sphere at an arm, perpendicular to the arm [1/kg]."""
    return (1.0 + TURNING * wp.length_sq(arm) / (radius * radius)) / mass


@wp.func
def spin_by(mass: float, radius: float, torque: wp.vec3):
    """Spin that a sphere gains [rad/s] by an angular momentum [N m s]."""
    return (TURNING / (mass * radius * radius)) * torque


@wp.func
def rubbed(
    velocity: wp.vec3, spin: wp.vec3, moving: wp.vec3, normal: wp.vec3, stopped: float, radius: float, friction: float
):
    """Return the gain of a sphere's velocity [m/s] and spin [rad/s] by friction on something immovable.

    Args:
        moving: how fast the other moves there [m/s].
        stopped: by how much the impulse along the normal has changed its velocity [m/s].
    """
    arm = -radius * normal
    beside = velocity + wp.cross(spin, arm) - moving
    gain = friction_impulse(beside, normal, inverse_mass_of_ball(1.0, radius, arm), friction * stopped)
    return gain, spin_by(1.0, radius, wp.cross(arm, gain))


BOX, CAPSULE, PLANE, MESH = wp.constant(0), wp.constant(1), wp.constant(2), wp.constant(3)
"""Kinds of shapes"""
SHAPES = ("box", "capsule", "plane", "mesh")
"""Names of the kinds of shapes, by their numbers"""
FAR_AWAY = wp.constant(1.0e30)
"""Distance of a mesh that a query did not find within its range [m]"""
MAX_ADVANCEMENTS = wp.constant(32)
"""Largest number of distance queries along a path that may enter a solid"""
BALL_ADVANCEMENTS = wp.constant(256)
"""Largest number of distance queries along a sphere's path beside a mesh"""
MOST_TURNS = wp.constant(4)
"""Largest number of passes over all solids in a path in a step, as one may push the path's end into another"""
SETTLED = wp.constant(1.0e-3)
"""Displacement of a path's end below which it counts as settled, over the path's length"""
MOST_SLIDES = wp.constant(3)
"""Largest number of slides of a particle along a mesh in a step"""
UNSEEN = wp.constant(0.02)
"""Depth of entry that may be missed between queries, over a mesh's skin"""
BLURRED = wp.constant(3.0e-5)
"""Distance to a mesh's surface, over the mesh's extent, below which float32 does not resolve the direction"""
LEAST_STEP = wp.constant(2.0e-6)
"""Shortest step along a path, over its length, that float32 resolves"""


@wp.func
def is_settled(start: wp.vec3, end: wp.vec3, point: wp.vec3):
    """Return whether solids in a path have hardly moved the path's end."""
    return wp.length(point - end) <= SETTLED * wp.length(end - start) + LEAST_STEP * wp.length(point)


@wp.func
def toward(arm: wp.vec3, otherwise: wp.vec3):
    """Return the direction of an arm, a unit vector; `otherwise` where there is none."""
    if wp.length_sq(arm) > 0.0:
        return wp.normalize(arm)
    return otherwise


@wp.func
def box_surface(point: wp.vec3, half: wp.vec3):
    """Return the distance to a box [m], and its normal; half its edges are given."""
    beyond = wp.vec3(wp.abs(point[0]) - half[0], wp.abs(point[1]) - half[1], wp.abs(point[2]) - half[2])
    signs = wp.vec3(
        wp.where(point[0] < 0.0, -1.0, 1.0), wp.where(point[1] < 0.0, -1.0, 1.0), wp.where(point[2] < 0.0, -1.0, 1.0)
    )
    inside = wp.max(beyond)
    if inside > 0.0:
        outside = wp.vec3(wp.max(beyond[0], 0.0), wp.max(beyond[1], 0.0), wp.max(beyond[2], 0.0))
        return wp.length(outside), toward(wp.cw_mul(outside, signs), signs)
    normal = wp.vec3(0.0, 0.0, signs[2])
    if inside == beyond[0]:
        normal = wp.vec3(signs[0], 0.0, 0.0)
    elif inside == beyond[1]:
        normal = wp.vec3(0.0, signs[1], 0.0)
    return inside, normal


@wp.func
def capsule_surface(point: wp.vec3, radius: float, half_length: float, up: wp.vec3):
    """Return the distance to a capsule along the up axis [m], and its normal."""
    arm = point - wp.clamp(wp.dot(point, up), -half_length, half_length) * up
    across = wp.vec3(up[1], up[2], up[0])
    return wp.length(arm) - radius, toward(arm, across)


@wp.func
def mesh_normal(arm: wp.vec3, face_normal: wp.vec3, side: float, reach: float):
    """Return the direction of the arm from the nearest place of a mesh to a point, a unit vector, turned to a side.

    It is that face's normal where float32 would tell no direction.
    """
    if wp.length_sq(arm) > (BLURRED * reach) * (BLURRED * reach):
        return side * wp.normalize(arm)
    return face_normal


@wp.func
def mesh_surface(mesh: wp.uint64, closed: wp.int32, point: wp.vec3, farthest: float, reach: float, blur: float):
    """Return the distance to a mesh [m], and its normal; `FAR_AWAY` where there is nothing within `farthest`.

    A sheet has two sides: its normal is on that of the point.
    """
    if closed != 0:
        found = wp.mesh_query_point_sign_normal(mesh, point, farthest, blur)
        if found.result:
            arm = point - wp.mesh_eval_position(mesh, found.face, found.u, found.v)
            normal = mesh_normal(arm, wp.mesh_eval_face_normal(mesh, found.face), found.sign, reach)
            return found.sign * wp.length(arm), normal
        return FAR_AWAY, wp.vec3()
    seen = wp.mesh_query_point_no_sign(mesh, point, farthest)
    if seen.result:
        arm = point - wp.mesh_eval_position(mesh, seen.face, seen.u, seen.v)
        facing = wp.mesh_eval_face_normal(mesh, seen.face)
        normal = mesh_normal(arm, wp.where(wp.dot(arm, facing) < 0.0, -facing, facing), 1.0, reach)
        return wp.length(arm), normal
    return FAR_AWAY, wp.vec3()


@wp.func
def outward_direction(point: wp.vec3, center: wp.vec3, up: wp.vec3):
    """Outward direction from a sphere's center to a particle, a unit vector; up where they coincide."""
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
    """Part of an approach speed that a step stops [m/s]: depth behind the surface over step.

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
        outward = outward_direction(point, center, up)
        depth = radius - wp.dot(point - center, outward)
        approach = -wp.dot(velocity - sphere_velocity, outward)
        point = center + radius * outward
        velocity += stopped_in_step(approach, depth, step_seconds) * outward
    return point, velocity, outward


@wp.func
def resolve_at_surface(
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
    """Move a particle up to the ground's height, and slow it, see `resolve_at_surface`."""
    depth = height - wp.dot(point, up)
    if depth > 0.0:
        place = point + depth * up
        stood, slowed = resolve_at_surface(point, place, velocity, wp.vec3(), up, friction, step_seconds, at_once, 1.0)
        point = stood
        velocity = slowed
    return point, velocity


@wp.func
def out_of_sphere(point: wp.vec3, normal: wp.vec3, center: wp.vec3, radius: float, up: wp.vec3):
    """Project a point out of a sphere, and return it with the contact normal; unchanged if it is outside."""
    if wp.length_sq(point - center) < radius * radius:
        normal = outward_direction(point, center, up)
        point = center + radius * normal
    return point, normal


@wp.func
def penalty_force(penalty: float, inflation: wp.vec3, outward: wp.vec3):
    """Force on a sphere [N] from a particle that it moved `outward`."""
    squared = squared_length(inflation)
    return (-penalty * squared * inverse_root(squared)) * outward


@wp.func
def stop_of(coming: float, depth: float, before: float, restitution: float, step_seconds: float):
    """Speed change of a sphere along the normal of a surface that it meets in a step [m/s].

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
Press = wp.types.vector(length=18, dtype=wp.float32)
"""Sums over the particles that a body presses: m n n^T [kg], its six different numbers, and m a n [kg m/s]; and over
those that overlap it: the same, and m n times the distance to move each out [kg m]"""
PRESSED, OVERLAPPING = wp.constant(0), wp.constant(9)
"""Offsets of the two sets of numbers in `Press`"""
MOST_ITERATIONS = wp.constant(16)
"""Largest number of Newton iterations; two or three usually suffice"""
NEAR_BODY = wp.constant(65.0 / 64.0)
"""Radius within which particles are considered, over a body's radius"""
APART_RATE = wp.constant(10.0)
"""Rate at which an overlap decays [1/s]"""
MOST_APART = wp.constant(0.2)
"""Largest fraction of an overlap that is removed in a step"""
FREE = wp.constant(-1.0e30)
"""Marker: excess speed of a particle that is not near [m/s]"""
GROUND_MASS = wp.constant(wp.float64(1.0e6))
"""Mass of the ground over the total mass of all that moves"""


@wp.func
def excess_speed(gap: float, approach: float, step_seconds: float):
    """Return the excess approach speed of two things [m/s], beyond the speed that closes the gap in a step."""
    return approach - wp.max(gap, 0.0) / step_seconds


@wp.func
def separation(gap: float, step_seconds: float):
    """Separation of two overlapping things in a step [m]."""
    return wp.max(-gap, 0.0) * wp.min(APART_RATE * step_seconds, MOST_APART)


@wp.func
def comes_near(start: wp.vec3, displacement: wp.vec3, radius: float):
    """Return whether a particle may meet a sphere in a step.

    The test doubles the particle's path and enlarges the sphere a little.

    Args:
        start: Position relative to the sphere's center before the step [m].
        displacement: Displacement relative to the sphere in the step [m].
    """
    nearest = start + wp.clamp(-wp.dot(start, displacement) / squared_length(displacement), 0.0, 2.0) * displacement
    return wp.length_sq(nearest) < (NEAR_BODY * radius) * (NEAR_BODY * radius)


@wp.func
def meet_sphere(start: wp.vec3, displacement: wp.vec3, radius: float, up: wp.vec3, step_seconds: float):
    """Return the direction from a sphere to a particle, the excess approach speed, and the displacement out.

    Args:
        start: from the sphere's center, before the step.
        displacement: in the step, beside the sphere, without contact.
    """
    outward = wp.vec3()
    excess = float(FREE)
    out = float(0.0)
    if comes_near(start, displacement, radius):
        outward = outward_direction(start, wp.vec3(), up)
        gap = wp.dot(start, outward) - radius
        excess = excess_speed(gap, -wp.dot(displacement, outward) / step_seconds, step_seconds)
        out = separation(gap, step_seconds)
    return outward, excess, out


@wp.func
def is_pressed(outward: wp.vec3, excess: float, change: wp.vec3):
    """Return whether a body with a given velocity change presses a particle."""
    return wp.dot(outward, change) + excess > 0.0


@wp.func
def put_part(press: Press, first: wp.int32, mass: float, outward: wp.vec3, rest: float):
    """Store m n n^T and m `rest` n as nine numbers."""
    towards = mass * outward
    lost = rest * towards
    press[first] = towards[0] * outward[0]
    press[first + 1] = towards[0] * outward[1]
    press[first + 2] = towards[0] * outward[2]
    press[first + 3] = towards[1] * outward[1]
    press[first + 4] = towards[1] * outward[2]
    press[first + 5] = towards[2] * outward[2]
    press[first + 6] = lost[0]
    press[first + 7] = lost[1]
    press[first + 8] = lost[2]
    return press


@wp.func
def press_of_particle(mass: float, outward: wp.vec3, excess: float, out: float, change: wp.vec3):
    """Return a particle's contribution to `Press`, beside a body with a given velocity change."""
    press = Press()
    if is_pressed(outward, excess, change):
        press = put_part(press, PRESSED, mass, outward, excess)
    if out > 0.0:
        press = put_part(press, OVERLAPPING, mass, outward, out)
    return press


@wp.func
def mass_in(press: Press, first: wp.int32):
    """Return the mass of the pressing particles from nine numbers [kg], the trace of the sum of m n n^T."""
    return press[first] + press[first + 3] + press[first + 5]


@wp.func
def is_met(press: Press):
    """Return whether any particle presses a body or overlaps it."""
    return mass_in(press, PRESSED) + mass_in(press, OVERLAPPING) > 0.0


@wp.func
def common_inertia(press: Press, first: wp.int32, mass: float, ground: wp.float64, up: wp.vec3):
    """Return M I + sum m n n^T of a body and the particles that it meets [kg], from nine numbers."""
    m = wp.float64(mass)
    xy = wp.float64(press[first + 1])
    xz = wp.float64(press[first + 2])
    yz = wp.float64(press[first + 4])
    xx = m + wp.float64(press[first])
    yy = m + wp.float64(press[first + 3])
    zz = m + wp.float64(press[first + 5])
    high = wp.vec3d(up)
    return wp.mat33d(xx, xy, xz, xy, yy, yz, xz, yz, zz) + ground * wp.outer(high, high)


@wp.func
def common_gain(press: Press, first: wp.int32, mass: float, ground: wp.float64, up: wp.vec3, sinking: float):
    """Return the solution D of (M I + sum m n n^T) D = -sum m a n.

    The sums are nine numbers; the ground counts as one more particle of its own mass.
    """
    lost = wp.vec3d(wp.float64(press[first + 6]), wp.float64(press[first + 7]), wp.float64(press[first + 8]))
    lost -= (ground * wp.float64(sinking)) * wp.vec3d(up)
    return -wp.vec3(wp.inverse(common_inertia(press, first, mass, ground, up)) * lost)


@wp.func
def ground_beside(press: Press, mass: float, up: wp.vec3, sinking: float, change: wp.vec3):
    """Return the mass of the ground [kg], where a body with a given velocity change is pressed to it, or 0."""
    if is_pressed(-up, sinking, change):
        return GROUND_MASS * wp.float64(mass + mass_in(press, PRESSED))
    return wp.float64(0.0)


@wp.func
def change_of_body(press: Press, mass: float, up: wp.vec3, sinking: float, change: wp.vec3):
    """Return the change of a body's velocity by the particles that it presses [m/s].

    Args:
        sinking: Excess approach speed toward the ground [m/s], see `excess_speed`.
        change: Velocity change for which the pressed particles were found; the ground's contact is found here.
    """
    ground = ground_beside(press, mass, up, sinking, change)
    return common_gain(press, PRESSED, mass, ground, up, sinking)


@wp.func
def push_of_ground(press: Press, mass: float, up: wp.vec3, change: wp.vec3):
    """Return the impulse of the ground on a body that particles press to it [N s]."""
    lost = wp.vec3(press[PRESSED + 6], press[PRESSED + 7], press[PRESSED + 8])
    of_particles = wp.vec3(
        press[PRESSED] * change[0] + press[PRESSED + 1] * change[1] + press[PRESSED + 2] * change[2],
        press[PRESSED + 1] * change[0] + press[PRESSED + 3] * change[1] + press[PRESSED + 4] * change[2],
        press[PRESSED + 2] * change[0] + press[PRESSED + 4] * change[1] + press[PRESSED + 5] * change[2],
    )
    return wp.max(wp.dot(up, mass * change + of_particles + lost), 0.0)


@wp.func
def shift_of_body(press: Press, mass: float, up: wp.vec3):
    """Return the displacement of a body out of the particles that overlap it [m]."""
    return common_gain(press, OVERLAPPING, mass, wp.float64(0.0), up, 0.0)


@wp.func
def is_converged(change: wp.vec3, last: wp.vec3):
    """Return whether another iteration changed nothing."""
    return wp.length_sq(change - last) <= 1.0e-12 * wp.length_sq(change)


@wp.func
def gain_of_particle(outward: wp.vec3, excess: float, change: wp.vec3):
    """Return the velocity change of a pressed particle for that of its body [m/s].

    Or how far one is moved out of an overlap [m], beside a body that is moved itself.
    """
    return (wp.dot(outward, change) + excess) * outward


@wp.func
def fall(
    position: wp.vec3,
    velocity: wp.vec3,
    pushed: wp.vec3,
    radius: float,
    gravity: float,
    up: wp.vec3,
    ground_height: float,
    ground_restitution: float,
    step_seconds: float,
):
    """Return a sphere's position and velocity after a step of gravity beside the ground.

    Also the velocity change by the ground [m/s].

    It has not met particles yet, or has the acceleration by their forces, `pushed` [m/s^2].

    It turns beside the ground as `stop_of` has it.
    """
    gap = wp.dot(position, up) - radius - ground_height
    rise = wp.dot(velocity, up)
    velocity += step_seconds * (pushed - gravity * up)
    coming = -wp.dot(velocity, up)
    stopped = stop_of(coming, step_seconds * coming - gap, -rise, ground_restitution, step_seconds)
    velocity += stopped * up
    position += step_seconds * velocity + separation(gap, step_seconds) * up
    return position, velocity, stopped


@wp.func
def sinking_of_sphere(
    position: wp.vec3, velocity: wp.vec3, radius: float, up: wp.vec3, ground_height: float, step_seconds: float
):
    """Return the excess approach speed of a moved sphere toward the ground [m/s], at most 0."""
    start = position - step_seconds * velocity
    return excess_speed(wp.dot(start, up) - radius - ground_height, -wp.dot(velocity, up), step_seconds)


NEVER = wp.constant(2.0)
"""Marker: time of impact, as a fraction of the step, that is never reached"""
SLOW = wp.constant(2.0)
"""Approach speed below which nothing rebounds, in steps of gravity, so that a sphere on another comes to rest"""


@wp.func
def part_until(start: wp.vec3, displacement: wp.vec3, reach: float):
    """Return the fraction of a path at which its distance from the origin is `reach`.

    It is 0 where the way begins nearer, and `NEVER` where it does not lead there.
    """
    away = wp.length(start)
    if away <= reach:
        return 0.0
    length = wp.length(displacement)
    part = float(NEVER)
    if length > 0.0:
        ahead = displacement / length
        along = -wp.dot(start, ahead)
        beside = start + along * ahead
        depth = reach * reach - wp.length_sq(beside)
        if along > 0.0 and depth > 0.0:
            # the nearer root, without a difference of large numbers
            part = (away - reach) * (away + reach) / (along + wp.sqrt(depth)) / length
    return wp.where(part <= 1.0, part, NEVER)


@wp.func
def mean_restitution(first: float, second: float):
    """Return the geometric mean of two coefficients of restitution: zero if one of them is zero."""
    return wp.sqrt(first * second)


@wp.func
def collision(
    start: wp.vec3,
    displacement: wp.vec3,
    relative: wp.vec3,
    reach: float,
    restitution: float,
    gravity: float,
    up: wp.vec3,
    step_seconds: float,
):
    """Shift [m] and gain [m/s] of a sphere beside another, along n, and the part of the step after which they meet.

    Overlapping spheres may not approach, and are separated slowly, without speed.

    Args:
        start: from the other's center, before the step.
        displacement: in the step, beside the other.
        relative: its velocity beside the other's.
        reach: the sum of the radii.
    """
    shift = wp.vec3()
    gain = wp.vec3()
    part = part_until(start, displacement, reach)
    if part <= 1.0:
        normal = outward_direction(start + part * displacement, wp.vec3(), up)
        approach = wp.max(-wp.dot(relative, normal), 0.0)
        bounce = 1.0 + wp.where(approach > SLOW * step_seconds * wp.abs(gravity), restitution, 0.0)
        gain = (bounce * approach) * normal
        gap = wp.min(wp.length(start) - reach, 0.0)
        least = reach + gap + separation(gap, step_seconds)
        further = wp.max(least - wp.dot(start + displacement, normal), 0.0)
        shift = (wp.where(gap < 0.0, 1.0, bounce) * further) * normal
    return shift, gain, part


@wp.func
def share_of(own: float, other: float):
    """Return one body's share of the relative velocity change of two bodies, from their masses [kg]."""
    return other / (own + other)
