"""Free rigid bodies: their poses before and after a step, and the response of particles and balls."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.contact_tables import Solid
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.impulse import FREE, way_apart
from balloon_warp.kernels.laws.rigid import spin_of, turned
from balloon_warp.kernels.loops.ways import way_function
from balloon_warp.kernels.tables import Tables, WorldState, row_of_world

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
    rigid.spin = spin_of(rigid.start_turn, t.bodies.eases[body], rigid.mass, rigid.momentum)
    return rigid


@wp.func
def pushed_on(t: Tables, rigid: Rigid, gain: wp.vec3, twist: wp.vec3, shift: wp.vec3):
    """Return a body after a change of velocity [m/s] and angular momentum [kg m^2/s] at the start of the step."""
    ease = t.bodies.eases[rigid.number]
    rigid.velocity += gain
    rigid.momentum += twist
    rigid.end += t.step_seconds * gain + shift
    rigid.end_turn = turned(rigid.start_turn, ease, rigid.mass, rigid.momentum, t.step_seconds)
    rigid.spin = spin_of(rigid.start_turn, ease, rigid.mass, rigid.momentum)
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
    let_through = way_function(features.body_meshes)

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
                stop.excess = wp.min(depth / step_seconds, -wp.dot(beside, stop.normal))
                stop.out = way_apart(step_seconds * wp.max(stop.excess, 0.0) - depth, step_seconds)
        return stop

    return stop_at
