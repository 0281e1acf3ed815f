"""Contact with spheres and with the ground (paper, "Collision Detection and Resolution").

A particle inside a sphere moves out along center -> particle. Its velocity into the sphere is taken away too: the paper
leaves it, but then a particle pressed against a sphere gathers speed for as long as it is pressed.

The sphere gets, by one of two rules,

- "penalty", the paper's: a force against that movement, proportional to how inflated the balloon is: the particle's own
  inflation force times the sphere's `penalty`, so that the sphere feels pressure times contact area. The particle's
  momentum into the sphere is lost, and the sphere's comes from nowhere.
- "impulse": the momentum that the particle loses, and nothing else. See `collide`.
"""

import warp as wp

from balloon_warp.kernels.gas import inflation_of_kind
from balloon_warp.kernels.springs import inverse_root, squared_length


@wp.func
def way_out(point: wp.vec3, center: wp.vec3, up: wp.vec3):
    """Unit vector from a sphere's center to a particle; up where they coincide."""
    arm = point - center
    if wp.length_sq(arm) > 0.0:
        return inverse_root(squared_length(arm)) * arm
    return up


@wp.func
def without_approach(velocity: wp.vec3, obstacle_velocity: wp.vec3, normal: wp.vec3):
    """The velocity less its part into the obstacle."""
    return velocity - wp.min(wp.dot(velocity - obstacle_velocity, normal), 0.0) * normal


@wp.func
def leave_sphere(
    point: wp.vec3, velocity: wp.vec3, center: wp.vec3, sphere_velocity: wp.vec3, radius: float, up: wp.vec3
):
    """A particle out of a sphere: its point, its velocity, and the unit vector it moved along, zero if outside."""
    outward = wp.vec3()
    if wp.length_sq(point - center) < radius * radius:
        outward = way_out(point, center, up)
        point = center + radius * outward
        velocity = without_approach(velocity, sphere_velocity, outward)
    return point, velocity, outward


@wp.func
def leave_ground(point: wp.vec3, velocity: wp.vec3, up: wp.vec3, height: float, friction: float):
    """A particle up to the ground's height. The speed into the ground is stopped, and by Coulomb's law at most
    `friction` times as much of the speed along it."""
    depth = height - wp.dot(point, up)
    if depth > 0.0:
        point += depth * up
        rise = wp.dot(velocity, up)
        along = velocity - rise * up
        stopped = wp.max(-rise, 0.0)
        kept = wp.max(1.0 - friction * stopped * inverse_root(squared_length(along)), 0.0)
        velocity = kept * along + wp.max(rise, 0.0) * up
    return point, velocity


@wp.func
def out_of_sphere(point: wp.vec3, normal: wp.vec3, center: wp.vec3, radius: float, up: wp.vec3):
    """Where a sphere lets a point go, and the obstacle's normal there; both as they are if it is outside."""
    if wp.length_sq(point - center) < radius * radius:
        normal = way_out(point, center, up)
        point = center + radius * normal
    return point, normal


@wp.func
def above_ground(point: wp.vec3, normal: wp.vec3, up: wp.vec3, height: float):
    """Where the ground lets a point go, and the obstacle's normal there; both as they are if it is above."""
    depth = height - wp.dot(point, up)
    if depth > 0.0:
        normal = up
        point += depth * up
    return point, normal


@wp.func
def penalty_force(penalty: float, inflation: wp.vec3, outward: wp.vec3):
    """Force on a sphere [N] from a particle that it moved `outward`."""
    squared = squared_length(inflation)
    return (-penalty * squared * inverse_root(squared)) * outward


@wp.func
def collide(mass: float, sphere_part: float, velocity: wp.vec3, stopped: wp.vec3, step_seconds: float):
    """A particle that left a sphere, and a part of the sphere's mass [kg], as an inelastic collision: the velocity of
    the particle, and the force on the sphere [N] that gives it in the next step what the particle loses in this one.

    The part is the particle's share of its balloon's mass, shared out to the balloons: those of all particles add up to
    the sphere at most. So the sphere as a whole gets what its parts get, each from the velocities before the step, and
    never turns back, however many particles touch it. Each collision takes away energy, and so does the sphere's coming
    to one velocity. The force's line goes through both centers, so that nothing is turned.

    Args:
        velocity: before the contact.
        stopped: the same without its part into the sphere, as if the sphere could not be moved.
    """
    after = velocity + sphere_part / (mass + sphere_part) * (stopped - velocity)
    return after, (mass / step_seconds) * (velocity - after)


@wp.func
def move_sphere(
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
    """Position and velocity of a sphere after a step: gravity, the ground, and the acceleration by contacts."""
    velocity += step_seconds * (pushed - gravity * up)
    position += step_seconds * velocity
    depth = ground_height + radius - wp.dot(position, up)
    if depth > 0.0:
        position += depth * up
        velocity -= (1.0 + ground_restitution) * wp.min(wp.dot(velocity, up), 0.0) * up
    return position, velocity


@wp.kernel
def resolve_contacts(
    # model
    particle_balloon: wp.array[wp.int32],
    particle_mass_share: wp.array[float],
    mass: wp.array2d[float],
    inflation_kind: wp.array[wp.int32],
    sphere_mass: wp.array2d[float],
    sphere_radius: wp.array2d[float],
    sphere_penalty: wp.array2d[float],
    up: wp.vec3,
    ground_height: wp.array[float],
    ground_friction: wp.array[float],
    impulses: bool,
    step_seconds: float,
    time_in_frame: float,
    # state in
    inflation_aims: wp.array2d[wp.vec3],
    inflation_ramp: wp.array2d[wp.vec2],
    inflation_loads: wp.array2d[wp.vec2],
    sphere_positions: wp.array2d[wp.vec3],
    sphere_velocities: wp.array2d[wp.vec3],
    points: wp.array2d[wp.vec3],
    velocities: wp.array2d[wp.vec3],
    # state out
    new_points: wp.array2d[wp.vec3],
    new_velocities: wp.array2d[wp.vec3],
    sphere_forces: wp.array2d[wp.vec3],
):
    """A thread a (world, particle): out of every sphere, then above the ground. Adds to `sphere_forces`."""
    world, particle = wp.tid()
    point = points[world, particle]
    velocity = velocities[world, particle]
    share = particle_mass_share[particle]
    if share > 0.0:
        balloon = particle_balloon[particle]
        ramp = inflation_ramp[world, balloon]
        inflation = inflation_of_kind(
            inflation_kind[balloon],
            ramp[0] + ramp[1] * time_in_frame,
            inflation_loads[world, balloon],
            wp.dot(point, up),
            inflation_aims[world, particle],
        )
        for sphere in range(sphere_positions.shape[1]):
            center = sphere_positions[world, sphere]
            radius = sphere_radius[world % sphere_radius.shape[0], sphere]
            point, stopped, outward = leave_sphere(
                point, velocity, center, sphere_velocities[world, sphere], radius, up
            )
            if wp.length_sq(outward) > 0.0:
                penalty = sphere_penalty[world % sphere_penalty.shape[0], sphere]
                push = penalty_force(penalty, inflation, outward)
                if impulses:
                    sphere_part = share * sphere_mass[world % sphere_mass.shape[0], sphere] / float(mass.shape[1])
                    own = share * mass[world % mass.shape[0], balloon]
                    stopped, push = collide(own, sphere_part, velocity, stopped, step_seconds)
                velocity = stopped
                wp.atomic_add(sphere_forces, world, sphere, push)
        height = ground_height[world % ground_height.shape[0]]
        friction = ground_friction[world % ground_friction.shape[0]]
        point, velocity = leave_ground(point, velocity, up, height, friction)
    new_points[world, particle] = point
    new_velocities[world, particle] = velocity


@wp.kernel
def move_spheres(
    # model
    sphere_mass: wp.array2d[float],
    sphere_radius: wp.array2d[float],
    gravity: wp.array[float],
    up: wp.vec3,
    ground_height: wp.array[float],
    ground_restitution: wp.array[float],
    step_seconds: float,
    # state in and out
    sphere_positions: wp.array2d[wp.vec3],
    sphere_velocities: wp.array2d[wp.vec3],
    sphere_forces: wp.array2d[wp.vec3],
):
    """A thread a (world, sphere): gravity, the contacts since the last step (then cleared), and the ground."""
    world, sphere = wp.tid()
    position, velocity = move_sphere(
        sphere_positions[world, sphere],
        sphere_velocities[world, sphere],
        sphere_forces[world, sphere] / sphere_mass[world % sphere_mass.shape[0], sphere],
        sphere_radius[world % sphere_radius.shape[0], sphere],
        gravity[world % gravity.shape[0]],
        up,
        ground_height[world % ground_height.shape[0]],
        ground_restitution[world % ground_restitution.shape[0]],
        step_seconds,
    )
    sphere_positions[world, sphere] = position
    sphere_velocities[world, sphere] = velocity
    sphere_forces[world, sphere] = wp.vec3()
