"""How free rigid bodies move in a step before they meet particles: under gravity, beside the ground, obstacles, each
other, and then spheres. One thread takes all of a world, in the same order every time."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.laws.collision import SLOW
from balloon_warp.kernels.laws.contact import friction_between
from balloon_warp.kernels.laws.grip import Grip, grip_impulse, least_speed
from balloon_warp.kernels.laws.impulse import way_apart
from balloon_warp.kernels.laws.rigid import ease_along, spin_of, turned
from balloon_warp.kernels.laws.sliding import ease_of_ball, friction_impulse, spin_by
from balloon_warp.kernels.loops.bodies import Rigid, Stop, body_at, body_mass, pushed_on, put_body, stop_function
from balloon_warp.kernels.loops.nearest import near_function
from balloon_warp.kernels.tables import (
    Tables,
    WorldState,
    row_of_world,
    sphere_friction,
    sphere_mass,
    sphere_radius,
    sphere_restitution,
)
from balloon_warp.kernels.traits import Traits

SWEEPS = wp.constant(16)
"""over all points that touch, in a step"""


@wp.func
def velocity_at(t: Tables, state: WorldState, world: wp.int32, body: wp.int32, arm: wp.vec3):
    """Of a body's point, as the body is turned before it moves [m/s]."""
    mass = body_mass(t, world, body)
    spin = spin_of(state.body_turns[world, body], t.bodies.eases[body], mass, state.body_momenta[world, body])
    return state.body_velocities[world, body] + wp.cross(spin, arm)


@wp.func
def push_at(t: Tables, state: WorldState, world: wp.int32, body: wp.int32, arm: wp.vec3, impulse: wp.vec3):
    """An impulse on a body's point [N s]."""
    mass = body_mass(t, world, body)
    state.body_velocities[world, body] = state.body_velocities[world, body] + impulse / mass
    state.body_momenta[world, body] = state.body_momenta[world, body] + wp.cross(arm, impulse)


@wp.func
def ease_at(t: Tables, state: WorldState, world: wp.int32, body: wp.int32, arm: wp.vec3, normal: wp.vec3):
    """How much faster its point becomes along a unit vector by 1 N s [1/kg]."""
    return ease_along(state.body_turns[world, body], t.bodies.eases[body], body_mass(t, world, body), arm, normal)


@wp.func
def settle_grip(t: Tables, state: WorldState, world: wp.int32, body: wp.int32, grip: Grip, center: wp.vec3):
    """What is added to a point's impulse, which has acted then."""
    other_arm = wp.vec3()
    beside = velocity_at(t, state, world, body, grip.arm) - grip.moving
    ease = ease_at(t, state, world, body, grip.arm, grip.normal)
    if grip.other >= 0:
        other_arm = center + grip.arm - state.body_positions[world, grip.other]
        beside -= velocity_at(t, state, world, grip.other, other_arm)
        ease += ease_at(t, state, world, grip.other, other_arm, grip.normal)
    sliding = beside - wp.dot(beside, grip.normal) * grip.normal
    friction_ease = ease
    if wp.length_sq(sliding) > 0.0:
        ahead = wp.normalize(sliding)
        friction_ease = ease_at(t, state, world, body, grip.arm, ahead)
        if grip.other >= 0:
            friction_ease += ease_at(t, state, world, grip.other, other_arm, ahead)
    added = grip_impulse(grip, beside, ease, friction_ease)
    push_at(t, state, world, body, grip.arm, added)
    if grip.other >= 0:
        push_at(t, state, world, grip.other, other_arm, -added)
    return added


@cache
def tumbling_function(traits: Traits) -> Any:
    """The function that moves the bodies of a world by a step."""
    nearest_to = near_function(traits)
    stop_at = stop_function(traits)
    split = traits.columns.balloon_width
    gravity = traits.columns.places["gravity"] - split

    @wp.func
    def farthest_way(t: Tables, state: WorldState, world: wp.int32, body: wp.int32):
        """How much nearer than now a point of a body may come to anything in a step [m]."""
        fastest = t.fixtures.fastest
        for other in range(state.body_positions.shape[1]):
            mass = body_mass(t, world, other)
            spin = spin_of(
                state.body_turns[world, other], t.bodies.eases[other], mass, state.body_momenta[world, other]
            )
            speed = wp.length(state.body_velocities[world, other]) + wp.length(spin) * t.bodies.solids.reaches[other]
            fastest += speed
        return 1.01 * t.step_seconds * fastest

    @wp.func
    def take_hold(
        t: Tables,
        state: WorldState,
        world: wp.int32,
        body: wp.int32,
        sample: wp.int32,
        time: float,
        pull: float,
        within: float,
    ):
        """What a point of a body meets in a step that begins at a time, and by how far it overlaps that [m].

        Args:
            within: what is no nearer is not met [m].
        """
        told = t.bodies.samples[sample]
        grip = Grip()
        grip.other = -1
        center = state.body_positions[world, body]
        arm = wp.quat_rotate(state.body_turns[world, body], wp.vec3(told[0], told[1], told[2]))
        near = nearest_to(t, state, world, body, time, center + arm, told[3], within)
        overlap = float(0.0)
        if wp.length_sq(near.normal) > 0.0:
            grip.normal = near.normal
            grip.arm = arm - told[3] * near.normal
            grip.moving = near.moving
            grip.other = near.other
            beside = velocity_at(t, state, world, body, grip.arm) - near.moving
            if near.other >= 0:
                beside -= velocity_at(
                    t, state, world, near.other, center + grip.arm - state.body_positions[world, near.other]
                )
            own = t.bodies.restitution[row_of_world(world, t.bodies.restitution.shape[0]), body]
            rebound = wp.sqrt(own * near.restitution)
            grip.least = least_speed(near.gap, -wp.dot(beside, near.normal), rebound, pull, t.step_seconds)
            own_friction = t.bodies.friction[row_of_world(world, t.bodies.friction.shape[0]), body]
            grip.friction = friction_between(own_friction, near.friction)
            overlap = wp.max(-near.gap, 0.0)
        return grip, overlap

    @wp.func
    def move_body(t: Tables, state: WorldState, world: wp.int32, body: wp.int32, shift: wp.vec3):
        """By a step, and out of what it overlaps."""
        mass = body_mass(t, world, body)
        velocity = state.body_velocities[world, body]
        state.body_positions[world, body] = state.body_positions[world, body] + t.step_seconds * velocity + shift
        state.body_turns[world, body] = turned(
            state.body_turns[world, body], t.bodies.eases[body], mass, state.body_momenta[world, body], t.step_seconds
        )

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
        """The impulse of friction on a sphere that a body pushes [N s], which has turned it then."""
        mass = sphere_mass(t.spheres, world, sphere)
        radius = sphere_radius(t.spheres, world, sphere)
        spin = state.sphere_spins[world, sphere]
        arm = -radius * stop.normal
        place = stop.arm + arm  # from the body's center of mass
        twist = spin_of(rigid.start_turn, t.bodies.eases[body], rigid.mass, wp.cross(stop.arm, push))
        beside = velocity + push / mass + wp.cross(spin, arm)
        beside -= rigid.velocity - push / rigid.mass + wp.cross(rigid.spin - twist, place)
        across = beside - wp.dot(beside, stop.normal) * stop.normal
        ease = ease_of_ball(mass, radius, arm)
        ease += ease_along(rigid.start_turn, t.bodies.eases[body], rigid.mass, place, wp.normalize(across))
        own = t.bodies.friction[row_of_world(world, t.bodies.friction.shape[0]), body]
        friction = friction_between(own, sphere_friction(t.spheres, world, sphere))
        rub = friction_impulse(beside, stop.normal, ease, friction * wp.length(push))
        state.sphere_spins[world, sphere] = spin + spin_by(mass, radius, wp.cross(arm, rub))
        return rub

    @wp.func
    def meet_sphere(
        t: Tables,
        state: WorldState,
        starts: wp.array2d[wp.vec3],
        start_turns: wp.array2d[wp.quat],
        sphere_starts: wp.array2d[wp.vec3],
        world: wp.int32,
        body: wp.int32,
        sphere: wp.int32,
        pull: float,
    ):
        """A body that has moved and a sphere that has."""
        radius = sphere_radius(t.spheres, world, sphere)
        rigid = body_at(t, state, starts, start_turns, world, body)
        velocity = state.sphere_velocities[world, sphere]
        end = state.sphere_positions[world, sphere]
        stop = stop_at(t, rigid, sphere_starts[world, sphere], end, velocity, radius)
        if wp.length_sq(stop.normal) > 0.0:
            mass = sphere_mass(t.spheres, world, sphere)
            ease = 1.0 / mass + ease_along(rigid.start_turn, t.bodies.eases[body], rigid.mass, stop.arm, stop.normal)
            approach = -wp.dot(velocity - rigid.velocity - wp.cross(rigid.spin, stop.arm), stop.normal)
            gain = wp.max(stop.excess, 0.0)
            if gain > 0.0 and approach > SLOW * t.step_seconds * wp.abs(pull):
                own = t.bodies.restitution[row_of_world(world, t.bodies.restitution.shape[0]), body]
                gain = wp.max(gain, (1.0 + wp.sqrt(own * sphere_restitution(t.spheres, world, sphere))) * approach)
            push = (gain / ease) * stop.normal
            if wp.static(traits.spheres_rub):
                push += rub_sphere(t, state, world, body, sphere, rigid, stop, velocity, push)
            out = (stop.out / (1.0 / mass + 1.0 / rigid.mass)) * stop.normal
            state.sphere_velocities[world, sphere] = velocity + push / mass
            state.sphere_positions[world, sphere] = end + (t.step_seconds * push + out) / mass
            twist = -wp.cross(stop.arm, push)
            if wp.static(traits.spheres_rub):  # friction acts where they touch
                twist += radius * wp.cross(stop.normal, push)
            put_body(state, world, pushed_on(t, rigid, -push / rigid.mass, twist, -out / rigid.mass))

    @wp.func
    def tumble(
        t: Tables,
        state: WorldState,
        grips: wp.array2d[Grip],
        starts: wp.array2d[wp.vec3],
        start_turns: wp.array2d[wp.quat],
        sphere_starts: wp.array2d[wp.vec3],
        world: wp.int32,
        time: float,
    ):
        """All bodies, in a step that begins at a time [s]; spheres have moved."""
        bodies = state.body_positions.shape[1]
        pull = t.world_numbers[row_of_world(world, t.world_numbers.shape[0]), gravity]
        for body in range(bodies):
            starts[world, body] = state.body_positions[world, body]
            start_turns[world, body] = state.body_turns[world, body]
            fall = (t.step_seconds * pull) * t.up
            state.body_velocities[world, body] = state.body_velocities[world, body] - fall
        held = bool(False)
        for body in range(bodies):
            within = farthest_way(t, state, world, body)
            for sample in range(t.bodies.sample_offsets[body], t.bodies.sample_offsets[body + 1]):
                grip, _overlap = take_hold(t, state, world, body, sample, time, pull, within)
                grips[world, sample] = grip
                held = held or wp.length_sq(grip.normal) > 0.0
        if held:
            for _sweep in range(SWEEPS):
                for body in range(bodies):
                    for sample in range(t.bodies.sample_offsets[body], t.bodies.sample_offsets[body + 1]):
                        grip = grips[world, sample]
                        if wp.length_sq(grip.normal) > 0.0:
                            grip.impulse += settle_grip(t, state, world, body, grip, state.body_positions[world, body])
                            grips[world, sample] = grip
        for body in range(bodies):
            shift = wp.vec3()
            if held:
                deepest = float(0.0)
                for sample in range(t.bodies.sample_offsets[body], t.bodies.sample_offsets[body + 1]):
                    if wp.length_sq(grips[world, sample].normal) > 0.0:
                        grip, overlap = take_hold(t, state, world, body, sample, time, pull, 0.0)
                        if overlap > deepest:
                            deepest = overlap
                            shift = way_apart(-overlap, t.step_seconds) * grip.normal
            move_body(t, state, world, body, shift)
        for sphere in range(state.sphere_positions.shape[1]):
            if sphere_radius(t.spheres, world, sphere) > 0.0:
                for body in range(bodies):
                    meet_sphere(t, state, starts, start_turns, sphere_starts, world, body, sphere, pull)

    return tumble
