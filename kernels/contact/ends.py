"""Ends of a contact: particles, and a body or a sphere. Their motion, their masses, and the impulses on them.

Impulses add up as whole numbers, the same in any order.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.contact.contact import (
    BALL,
    BODY,
    FIXED,
    NONE,
    Bearing,
    Contact,
    ContactImpulses,
    Motion,
    bears,
    on_end,
)
from balloon_warp.kernels.contact.ridges import body_of, sphere_of
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.contact import spin_by
from balloon_warp.kernels.laws.rigid import spin_of
from balloon_warp.kernels.loops.bodies import body_at, body_mass, pushed_on, put_body
from balloon_warp.kernels.loops.net_force import inverse_mass_function
from balloon_warp.kernels.tables import Tables, WorldState, row_of_world, sphere_mass, sphere_radius
from balloon_warp.kernels.working import Working

QUANTA = wp.constant(wp.float64(2.0**40))
"""Quanta in 1 N s, in 1 N m s, or in 1 kg m: a range of 8e6, and a resolution of 1e-6 m/s for a particle of 1 mg"""
ONE = wp.constant(wp.float64(2.0**-40))


@wp.func
def whole(amount: float):
    """Return an amount as a whole number."""
    return wp.int64(wp.float64(amount) * QUANTA)


@wp.func
def taken(sums: wp.array3d[wp.int64], world: wp.int32, item: wp.int32, axis: wp.int32):
    """Return a sum, and clear it."""
    total = sums[world, item, axis]
    sums[world, item, axis] = wp.int64(0)
    return float(wp.float64(total) * ONE)


@wp.func
def add_impulse(sums: wp.array3d[wp.int64], world: wp.int32, item: wp.int32, impulse: wp.vec3):
    """Add an impulse [N s] to a particle's."""
    for axis in range(3):
        wp.atomic_add(sums, world, item, axis, whole(impulse[axis]))


@wp.func
def add_to_solid(sums: wp.array3d[wp.int64], world: wp.int32, solid: wp.int32, impulse: wp.vec3, twist: wp.vec3):
    """Add an impulse [N s] and an angular momentum [N m s] to those of a body or a sphere."""
    for axis in range(3):
        wp.atomic_add(sums, world, solid, axis, whole(impulse[axis]))
        wp.atomic_add(sums, world, solid, axis + 3, whole(twist[axis]))


@wp.func
def take_impulse(sums: wp.array3d[wp.int64], world: wp.int32, item: wp.int32):
    """Take the impulse on a particle [N s]."""
    return wp.vec3(taken(sums, world, item, 0), taken(sums, world, item, 1), taken(sums, world, item, 2))


@wp.func
def take_of_solid(sums: wp.array3d[wp.int64], world: wp.int32, solid: wp.int32):
    """Take the impulse on a body or a sphere [N s], and the angular momentum [N m s]."""
    impulse = take_impulse(sums, world, solid)
    twist = wp.vec3(taken(sums, world, solid, 3), taken(sums, world, solid, 4), taken(sums, world, solid, 5))
    return impulse, twist


@wp.func
def four_of(vectors: wp.array[wp.vec3], ends: wp.vec4i):
    """Return the vectors of four ends, row by row."""
    return wp.matrix_from_rows(vectors[ends[0]], vectors[ends[1]], vectors[ends[2]], vectors[ends[3]])


@cache
def motion_functions(features: Features) -> tuple[Any, Any]:
    """Return the functions of the kind of a contact's solid, and of its motion; an obstacle's is the contact's own."""

    @wp.func
    def kind_of(t: Tables, contact: Contact):
        if wp.static(features.bodies > 0):
            if body_of(t, contact.solid) >= 0:
                return BODY
        if wp.static(features.round_ridges):
            if sphere_of(t, contact.solid) >= 0:
                return BALL
        return FIXED

    @wp.func
    def motion_of(t: Tables, state: WorldState, working: Working, world: wp.int32, contact: Contact):
        motion = Motion()
        if wp.static(features.bodies > 0):
            body = body_of(t, contact.solid)
            if body >= 0:
                turn = working.body_start_turns[world, body]
                momentum = state.body_momenta[world, body]
                motion.velocity = state.body_velocities[world, body]
                motion.spin = spin_of(turn, t.bodies.inverse_inertias[body], body_mass(t, world, body), momentum)
        if wp.static(features.round_ridges):
            sphere = sphere_of(t, contact.solid)
            if sphere >= 0:
                motion.velocity = state.sphere_velocities[world, sphere]
                if wp.static(features.spheres_rub):
                    motion.spin = state.sphere_spins[world, sphere]
        return motion

    return kind_of, motion_of


@wp.func
def mover_of(t: Tables, contact: Contact):
    """Return the number of a contact's solid among bodies and then spheres, which move; below 0 if it does not."""
    return contact.solid - t.fixtures.solids.shape[0]


@cache
def bearing_function(features: Features) -> Any:
    """Return the function of the masses that bear a contact in a sweep."""
    inverse_mass_of = inverse_mass_function(features)
    kind_of, _ = motion_functions(features)

    @wp.func
    def bearing_of(t: Tables, working: Working, world: wp.int32, contact: Contact):
        bearing = Bearing()
        for end in range(4):
            particle = contact.ends[end]
            bearing.shares[end] = float(working.contact_shares[world, particle])
            bearing.inverse_masses[end] = inverse_mass_of(t, working, world, particle)
        bearing.kind = kind_of(t, contact)
        if wp.static(features.bodies > 0 or features.round_ridges):
            if bearing.kind != FIXED:
                bearing.share = float(working.solid_shares[world, mover_of(t, contact)])
        if wp.static(features.bodies > 0):
            if bearing.kind == BODY:
                body = body_of(t, contact.solid)
                bearing.mass = body_mass(t, world, body)
                bearing.turn = working.body_start_turns[world, body]
                bearing.inverse_inertia = t.bodies.inverse_inertias[body]
        if wp.static(features.round_ridges):
            if bearing.kind == BALL:
                sphere = sphere_of(t, contact.solid)
                bearing.mass = sphere_mass(t.spheres, world, sphere)
                bearing.radius = sphere_radius(t.spheres, world, sphere)
        return bearing

    return bearing_of


@cache
def adding_functions(features: Features) -> tuple[Any, Any]:
    """Return the functions that count a contact at its ends, and that add its impulses to theirs."""
    kind_of, _ = motion_functions(features)

    @wp.func
    def count_in(t: Tables, working: Working, world: wp.int32, contact: Contact):
        for end in range(4):
            if bears(contact, end):
                wp.atomic_add(working.contact_shares, world, contact.ends[end], 1)
        if wp.static(features.bodies > 0 or features.round_ridges):
            if kind_of(t, contact) != FIXED:
                wp.atomic_add(working.solid_shares, world, mover_of(t, contact), 1)

    @wp.func
    def add_impulses(
        t: Tables, working: Working, world: wp.int32, contact: Contact, impulses: ContactImpulses, speeds: float
    ):  # fmt: skip
        """Add the impulses of a contact, which are moves without speed where `speeds` is 0."""
        for end in range(4):
            if bears(contact, end):
                impulse = on_end(contact, impulses, end)
                add_impulse(working.contact_quanta, world, contact.ends[end], impulse)
                if wp.static(features.tells_contacts and features.edges_meet):
                    if contact.solid == NONE and speeds > 0.0:
                        add_impulse(working.layer_quanta, world, contact.ends[end], impulse)
        if wp.static(features.bodies > 0 or features.round_ridges):
            if kind_of(t, contact) != FIXED:
                twist = wp.cross(contact.arm, -impulses.impulse)
                add_to_solid(working.solid_quanta, world, mover_of(t, contact), -impulses.impulse, twist)

    return count_in, add_impulses


@cache
def gains_of_ball_function(features: Features) -> Any:
    """Return the function, of plain values, of the velocity and the spin that a sphere gains."""

    @wp.func
    def gains_of_ball(mass: float, radius: float, impulse: wp.vec3, torque: wp.vec3):
        gains = Motion()
        gains.velocity = impulse / mass
        if wp.static(features.spheres_rub):
            gains.spin = spin_by(mass, radius, torque)
        return gains

    return gains_of_ball


@wp.func
def stop_by_ground(rise: float, fall: float, step_seconds: float):
    """Return the upward speed that a particle gains which is put on the ground: no more than it fell at [m/s].

    Args:
        rise: How far it is raised [m].
        fall: Its upward speed, or 0 if it rises [m/s].
    """
    return wp.min(rise / step_seconds, -fall)


@wp.func
def forget_stop(working: Working, world: wp.int32, particle: wp.int32, rise: float, fall: float):
    """Note nothing of a particle that the ground stops."""
    return


@cache
def ground_function(features: Features, note: Any = forget_stop) -> Any:
    """Return the function that keeps a particle that others push above the ground.

    Args:
        note: function that keeps how far and how fast it would have gone on.
    """
    height = features.columns.places["ground_height"] - features.columns.balloon_width

    @wp.func
    def keep_above(
        t: Tables, working: Working, world: wp.int32, particle: wp.int32, point: wp.vec3, velocity: wp.vec3,
        speeds: float,
    ):  # fmt: skip
        """Return where a particle is that does not go through the ground, and its velocity.

        It goes as far as it can, and no faster: who pushes it then finds it no farther away. Were it taken out of the
        ground only in the next substep, it would go through a layer that lies on it.

        Args:
            speeds: 0 if it is moved without speed.
        """
        if wp.static(features.ground):
            rise = t.world_numbers[row_of_world(world, t.world_numbers.shape[0]), height] - wp.dot(point, t.up)
            if rise > 0.0:
                fall = wp.min(wp.dot(velocity, t.up), 0.0)
                note(working, world, particle, rise, fall)
                point += rise * t.up
                velocity += (speeds * stop_by_ground(rise, fall, t.step_seconds)) * t.up
        return point, velocity

    return keep_above


@cache
def moving_functions(features: Features, note: Any = forget_stop) -> tuple[Any, Any]:
    """Return the functions that move an end, and a solid, by its whole sum; the first thread that comes does it.

    Args:
        note: as in `ground_function`.
    """
    inverse_mass_of, keep_above = inverse_mass_function(features), ground_function(features, note)
    gains_of_ball = gains_of_ball_function(features)

    @wp.func
    def move_end(
        t: Tables, working: Working, world: wp.int32, particle: wp.int32, points: wp.array[wp.vec3],
        velocities: wp.array[wp.vec3], speeds: float,
    ):  # fmt: skip
        """Move a particle.

        Args:
            speeds: 1, or 0 where impulses are moves without speed.
        """
        if wp.atomic_exch(working.contact_shares, world, particle, 0) > 0:
            gain = inverse_mass_of(t, working, world, particle) * take_impulse(working.contact_quanta, world, particle)
            point = points[particle] + wp.where(speeds > 0.0, t.step_seconds, 1.0) * gain
            velocity = velocities[particle] + speeds * gain
            point, velocity = keep_above(t, working, world, particle, point, velocity, speeds)
            velocities[particle] = velocity
            points[particle] = point

    @wp.func
    def move_ball(
        t: Tables, state: WorldState, world: wp.int32, sphere: wp.int32, impulse: wp.vec3, torque: wp.vec3,
        speeds: float,
    ):  # fmt: skip
        gains = gains_of_ball(
            sphere_mass(t.spheres, world, sphere), sphere_radius(t.spheres, world, sphere), impulse, torque
        )
        shift = wp.where(speeds > 0.0, t.step_seconds, 1.0) * gains.velocity
        state.sphere_positions[world, sphere] = state.sphere_positions[world, sphere] + shift
        state.sphere_velocities[world, sphere] = state.sphere_velocities[world, sphere] + speeds * gains.velocity
        force = (speeds / t.step_seconds) * impulse
        state.sphere_forces[world, sphere] = state.sphere_forces[world, sphere] + force
        if wp.static(features.spheres_rub):
            state.sphere_spins[world, sphere] = state.sphere_spins[world, sphere] + speeds * gains.spin

    @wp.func
    def move_solid(t: Tables, state: WorldState, working: Working, world: wp.int32, contact: Contact, speeds: float):
        mover = mover_of(t, contact)
        if mover >= 0:
            if wp.atomic_exch(working.solid_shares, world, mover, 0) > 0:
                impulse, torque = take_of_solid(working.solid_quanta, world, mover)
                if wp.static(features.bodies > 0):
                    body = body_of(t, contact.solid)
                    if body >= 0:
                        rigid = body_at(t, state, working.body_starts, working.body_start_turns, world, body)
                        ways = impulse / rigid.mass
                        shift = (1.0 - speeds) * ways
                        put_body(state, world, pushed_on(t, rigid, speeds * ways, speeds * torque, shift))
                if wp.static(features.round_ridges):
                    sphere = sphere_of(t, contact.solid)
                    if sphere >= 0:
                        move_ball(t, state, world, sphere, impulse, torque, speeds)

    return move_end, move_solid
