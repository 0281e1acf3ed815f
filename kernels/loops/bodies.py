"""Free rigid bodies: poses, motion, and contact partners.

They move before they meet particles, under gravity, beside the ground, obstacles, each other, and then spheres. One
thread takes all of a world, in the same order every time.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.contact import FREE, SLOW, friction_impulse, inverse_mass_of_ball, separation, spin_by
from balloon_warp.kernels.laws.rigid import (
    AGREED,
    APART,
    gap_growth,
    inertia_in_world,
    inverse_mass_along,
    max_sweeps,
    min_speed,
    slowest_rebound,
    spin_of,
    turned,
    turned_by,
)
from balloon_warp.kernels.loops.fixtures import friction_between, number_of_body, number_of_sphere
from balloon_warp.kernels.loops.holding import (
    along_normal,
    apply_contact_impulses,
    contact_list_function,
    inverse_mass_at,
    relative_velocity_at,
    settle,
    tug_at,
)
from balloon_warp.kernels.loops.paths import path_function
from balloon_warp.kernels.tables import (
    Solid,
    Tables,
    WorldState,
    row_of_world,
    sphere_mass,
    sphere_radius,
    sphere_restitution,
)
from balloon_warp.kernels.working import Working

STRAIGHT = wp.constant(0.99)
"""Dot product of two unit vectors above which they count as parallel"""


@wp.struct
class Rigid:
    """A body in a step."""

    number: wp.int32
    start: wp.vec3  # of the center of mass [m]
    end: wp.vec3
    start_turn: wp.quat
    end_turn: wp.quat
    velocity: wp.vec3  # [m/s]
    momentum: wp.vec3  # angular [kg m^2/s]
    spin: wp.vec3  # at the start [rad/s]
    mass: float
    reach: float  # of its farthest point [m]


@wp.func
def body_mass(t: Tables, world: wp.int32, body: wp.int32):
    """Return the mass of a body [kg]."""
    return t.bodies.mass[row_of_world(world, t.bodies.mass.shape[0]), body]


@wp.func
def body_at(
    t: Tables,
    state: WorldState,
    starts: wp.array2d[wp.vec3],
    start_turns: wp.array2d[wp.quat],
    world: wp.int32,
    body: wp.int32,
):
    """Return a body that has moved, from where it was."""
    rigid = Rigid()
    rigid.number = body
    rigid.start = starts[world, body]
    rigid.end = state.body_positions[world, body]
    rigid.start_turn = start_turns[world, body]
    rigid.end_turn = state.body_turns[world, body]
    rigid.velocity = state.body_velocities[world, body]
    rigid.momentum = state.body_momenta[world, body]
    rigid.mass = body_mass(t, world, body)
    rigid.reach = t.bodies.solids[body].reach
    rigid.spin = spin_of(rigid.start_turn, t.bodies.inverse_inertias[body], rigid.mass, rigid.momentum)
    return rigid


@wp.func
def pushed_on(t: Tables, rigid: Rigid, gain: wp.vec3, twist: wp.vec3, shift: wp.vec3):
    """Return a body after a change of velocity [m/s] and angular momentum [kg m^2/s] at the start of the step."""
    inverse_mass = t.bodies.inverse_inertias[rigid.number]
    rigid.velocity += gain
    rigid.momentum += twist
    rigid.end += t.step_seconds * gain + shift
    rigid.end_turn = turned(rigid.start_turn, inverse_mass, rigid.mass, rigid.momentum, t.step_seconds)
    rigid.spin = spin_of(rigid.start_turn, inverse_mass, rigid.mass, rigid.momentum)
    return rigid


@wp.func
def put_body(state: WorldState, world: wp.int32, rigid: Rigid):
    """Store a body's pose and velocities after the step."""
    state.body_positions[world, rigid.number] = rigid.end
    state.body_turns[world, rigid.number] = rigid.end_turn
    state.body_velocities[world, rigid.number] = rigid.velocity
    state.body_momenta[world, rigid.number] = rigid.momentum


@wp.struct
class Stop:
    """Response of a body to a particle that touches it."""

    normal: wp.vec3  # out of the body, zero where they do not meet
    arm: wp.vec3  # from the center of mass to the particle, at the start of the step [m]
    excess: float  # by how much it comes too fast [m/s]
    out: float  # how far it is to be moved out of an overlap [m]


@cache
def stop_function(features: Features) -> Any:
    """Return the function by which a body stops a particle, or a ball."""
    let_through = path_function(features.body_meshes)

    @wp.func
    def stop_at(
        solid: Solid,
        up: wp.vec3,
        step_seconds: float,
        rigid: Rigid,
        start: wp.vec3,
        end: wp.vec3,
        velocity: wp.vec3,
        radius: float,
    ):
        """Return the body's response to a particle's path in the step."""
        stop = Stop()
        stop.excess = float(FREE)
        stop.arm = start - rigid.start
        arm = end - rigid.end
        way = wp.length(arm - stop.arm) + step_seconds * wp.length(rigid.spin) * rigid.reach
        if wp.length(arm) - rigid.reach - radius <= way:
            let, outward, _free, _slides, _part = let_through(
                solid, up, wp.quat_rotate_inv(rigid.start_turn, stop.arm),
                wp.quat_rotate_inv(rigid.end_turn, arm), radius,
            )  # fmt: skip
            if wp.length_sq(outward) > 0.0:
                back = wp.quat_rotate(rigid.end_turn, let) - arm
                depth = wp.length(back)
                stop.normal = wp.quat_rotate(rigid.end_turn, outward)
                if wp.dot(back, stop.normal) < STRAIGHT * depth:  # it slid off more than one side of the body
                    stop.normal = wp.normalize(back)
                beside = velocity - rigid.velocity - wp.cross(rigid.spin, stop.arm)
                approach = -wp.dot(beside, stop.normal)
                stop.excess = wp.min(depth / step_seconds, approach)
                stop.out = separation(step_seconds * wp.max(approach, 0.0) - depth, step_seconds)
        return stop

    return stop_at


@wp.func
def begin(t: Tables, state: WorldState, working: Working, world: wp.int32, body: wp.int32):
    """Store a body's state before the step, and clear its displacement out of overlaps."""
    mass = body_mass(t, world, body)
    inverse_inertia = inertia_in_world(state.body_turns[world, body], t.bodies.inverse_inertias[body])
    working.body_masses[world, body] = mass
    working.body_inverse_inertias[world, body] = wp.mat33d(inverse_inertia / mass)
    working.body_going[world, body] = wp.vec3d()
    working.body_turning[world, body] = wp.vec3d()


@wp.func
def part(t: Tables, state: WorldState, working: Working, world: wp.int32, count: wp.int32):
    """Move bodies that overlap apart, each by its mass and inertia, without speed; how far each gap is then.

    Angular momentum turns with its body: it would else spin faster about an axis of less inertia.
    """
    deepest = float(0.0)
    for number in range(count):
        grip = working.grips[world, number]
        deepest = wp.max(deepest, -grip.gap)
        grip.least = gap_growth(grip.gap, t.step_seconds) - wp.dot(grip.normal, grip.moving)
        grip.impulse = wp.vec3d()
        working.grips[world, number] = grip
    if deepest > 0.0:
        settle(working, world, count, False, APART * deepest, max_sweeps(count))
        for number in range(count):
            grip = working.grips[world, number]
            grip.gap += float(along_normal(grip, relative_velocity_at(working, world, grip) + wp.vec3d(grip.moving)))
            working.grips[world, number] = grip
        for body in range(state.body_positions.shape[1]):
            shift = wp.vec3(working.body_going[world, body])
            turn = wp.vec3(working.body_inverse_inertias[world, body] * working.body_turning[world, body])
            state.body_positions[world, body] = state.body_positions[world, body] + shift
            state.body_turns[world, body] = turned_by(state.body_turns[world, body], turn)
            about = turned_by(wp.quat_identity(), turn)
            state.body_momenta[world, body] = wp.quat_rotate(about, state.body_momenta[world, body])
            begin(t, state, working, world, body)
        for number in range(count):
            grip = working.grips[world, number]
            grip.inverse_mass = inverse_mass_at(working, world, grip, grip.normal)
            working.grips[world, number] = grip


@wp.func
def aim(t: Tables, state: WorldState, working: Working, world: wp.int32, count: wp.int32, pull: float):
    """Set the target speed of each contact from its warm start, and return the fastest approach [m/s].

    Or a step of gravity or of strings, if that is faster.
    """
    slow = slowest_rebound(pull, t.step_seconds)
    fastest = t.step_seconds * wp.abs(pull)
    for number in range(count):
        grip = working.grips[world, number]
        grip.before = relative_velocity_at(working, world, grip)
        approach = -float(along_normal(grip, grip.before))
        faster = float(0.0)  # two bodies fall alike
        if grip.other < 0:
            faster = pull * wp.dot(grip.normal, t.up)
        tug = float(along_normal(grip, tug_at(working, world, grip)))
        faster -= tug / t.step_seconds
        slowest = slow + SLOW * wp.abs(tug)
        grip.closing = -wp.max(grip.gap, 0.0) / t.step_seconds
        grip.least = min_speed(grip.gap, approach, grip.restitution, faster, slowest, t.step_seconds)
        grip.impulse = state.body_impulses[world, number]
        working.grips[world, number] = grip
        fastest = wp.max(fastest, wp.max(approach, wp.abs(tug)))
    return fastest


@wp.func
def move_body(t: Tables, state: WorldState, working: Working, world: wp.int32, body: wp.int32):
    """Move a body by a step."""
    velocity = wp.vec3(working.body_going[world, body])
    momentum = wp.vec3(working.body_turning[world, body])
    state.body_velocities[world, body] = velocity
    state.body_momenta[world, body] = momentum
    state.body_positions[world, body] = state.body_positions[world, body] + t.step_seconds * velocity
    state.body_turns[world, body] = turned(
        state.body_turns[world, body], t.bodies.inverse_inertias[body], body_mass(t, world, body), momentum,
        t.step_seconds,
    )  # fmt: skip


@wp.func
def remember(state: WorldState, working: Working, world: wp.int32, count: wp.int32):
    """Keep the impulses of the list for the next step; a rebound's is not one to begin with."""
    for number in range(count):
        grip = working.grips[world, number]
        state.body_touches[world, number] = grip.key
        state.body_impulses[world, number] = wp.where(grip.least > 0.0, wp.vec3d(), grip.impulse)
    if count < state.body_touches.shape[1]:
        state.body_touches[world, count] = -1


@wp.func
def rub_sphere(
    t: Tables,
    state: WorldState,
    world: wp.int32,
    body: wp.int32,
    sphere: wp.int32,
    rigid: Rigid,
    stop: Stop,
    velocity: wp.vec3,
    push: wp.vec3,
):
    """Apply friction to a sphere that a body pushes, and return its impulse [N s]."""
    mass = sphere_mass(t.spheres, world, sphere)
    radius = sphere_radius(t.spheres, world, sphere)
    spin = state.sphere_spins[world, sphere]
    arm = -radius * stop.normal
    place = stop.arm + arm  # from the body's center of mass
    twist = spin_of(rigid.start_turn, t.bodies.inverse_inertias[body], rigid.mass, wp.cross(stop.arm, push))
    beside = velocity + push / mass + wp.cross(spin, arm)
    beside -= rigid.velocity - push / rigid.mass + wp.cross(rigid.spin - twist, place)
    across = beside - wp.dot(beside, stop.normal) * stop.normal
    inverse_mass = inverse_mass_of_ball(mass, radius, arm)
    inverse_mass += inverse_mass_along(
        rigid.start_turn, t.bodies.inverse_inertias[body], rigid.mass, place, wp.normalize(across)
    )
    friction = friction_between(t, world, number_of_body(t, body), number_of_sphere(t, sphere))
    rub = friction_impulse(beside, stop.normal, inverse_mass, friction * wp.length(push))
    state.sphere_spins[world, sphere] = spin + spin_by(mass, radius, wp.cross(arm, rub))
    return rub


@cache
def sphere_meeting_function(features: Features) -> Any:
    """Make the function by which a body that has moved meets a sphere that has."""
    stop_at = stop_function(features)

    @wp.func
    def meet_sphere(
        t: Tables,
        state: WorldState,
        working: Working,
        world: wp.int32,
        body: wp.int32,
        sphere: wp.int32,
        pull: float,
    ):
        """Resolve the collision of a body with a sphere, once both have moved."""
        radius = sphere_radius(t.spheres, world, sphere)
        rigid = body_at(t, state, working.body_starts, working.body_start_turns, world, body)
        velocity = state.sphere_velocities[world, sphere]
        end = state.sphere_positions[world, sphere]
        solid = t.bodies.solids[body]
        stop = stop_at(
            solid, t.up, t.step_seconds, rigid, working.sphere_starts[world, sphere], end, velocity, radius
        )  # fmt: skip
        if wp.length_sq(stop.normal) > 0.0:
            mass = sphere_mass(t.spheres, world, sphere)
            inverse_mass = 1.0 / mass + inverse_mass_along(
                rigid.start_turn, t.bodies.inverse_inertias[body], rigid.mass, stop.arm, stop.normal
            )
            approach = -wp.dot(velocity - rigid.velocity - wp.cross(rigid.spin, stop.arm), stop.normal)
            gain = wp.max(stop.excess, 0.0)
            # one of them may rest on something: gravity's last step is no speed to come back with
            approach -= t.step_seconds * wp.abs(pull * wp.dot(stop.normal, t.up))
            if gain > 0.0 and approach > slowest_rebound(pull, t.step_seconds):
                restitution = t.bodies.restitution[row_of_world(world, t.bodies.restitution.shape[0]), body]
                both = restitution * sphere_restitution(t.spheres, world, sphere)
                gain = wp.max(gain, (1.0 + wp.sqrt(both)) * approach)
            push = (gain / inverse_mass) * stop.normal
            if wp.static(features.spheres_rub):
                push += rub_sphere(t, state, world, body, sphere, rigid, stop, velocity, push)
            out = (stop.out / (1.0 / mass + 1.0 / rigid.mass)) * stop.normal
            state.sphere_velocities[world, sphere] = velocity + push / mass
            state.sphere_positions[world, sphere] = end + (t.step_seconds * push + out) / mass
            twist = -wp.cross(stop.arm, push)
            if wp.static(features.spheres_rub):  # friction acts where they touch
                twist += radius * wp.cross(stop.normal, push)
            put_body(state, world, pushed_on(t, rigid, -push / rigid.mass, twist, -out / rigid.mass))

    return meet_sphere


@cache
def body_motion_function(features: Features) -> Any:
    """Return the function that moves the bodies of a world by a step."""
    list_body_contacts = contact_list_function(features)
    meet_sphere = sphere_meeting_function(features)
    split = features.columns.balloon_width
    gravity = features.columns.places["gravity"] - split

    @wp.func
    def move_bodies(t: Tables, state: WorldState, working: Working, world: wp.int32, time_in_frame: float):
        """Move all bodies in a step that begins at a time in the frame [s]; spheres have moved."""
        bodies = state.body_positions.shape[1]
        pull = t.world_numbers[row_of_world(world, t.world_numbers.shape[0]), gravity]
        for body in range(bodies):
            begin(t, state, working, world, body)
        count = list_body_contacts(t, state, working, world, time_in_frame, pull)
        remember(state, working, world, count)
        part(t, state, working, world, count)
        for body in range(bodies):
            working.body_starts[world, body] = state.body_positions[world, body]
            working.body_start_turns[world, body] = state.body_turns[world, body]
            working.body_going[world, body] = wp.vec3d(state.body_velocities[world, body])
            working.body_turning[world, body] = wp.vec3d(state.body_momenta[world, body])
            if wp.static(features.ties):  # before they have pulled
                working.body_going[world, body] -= wp.vec3d(working.body_tugs[world, body])
                working.body_turning[world, body] -= wp.vec3d(working.body_twists[world, body])
        fastest = aim(t, state, working, world, count, pull)
        apply_contact_impulses(t, state, working, world, count, pull, AGREED * fastest)
        remember(state, working, world, count)
        for body in range(bodies):
            move_body(t, state, working, world, body)
        for sphere in range(state.sphere_positions.shape[1]):
            if sphere_radius(t.spheres, world, sphere) > 0.0:
                for body in range(bodies):
                    meet_sphere(t, state, working, world, body, sphere, pull)

    return move_bodies
