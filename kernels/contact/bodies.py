"""Contact of free rigid bodies and particles, a block a world.

Each piece of a substep is a launch, which loops over the particles in the same order every time.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.impulse import MOST_TURNS, shift_of_body
from balloon_warp.kernels.laws.rigid import (
    Change,
    Push,
    change_of_rigid,
    friction_share,
    gain_at,
    inertia_in_world,
    is_pushed,
    is_same,
    overlap_of,
    pressed_mass,
    push_of_particle,
    rub_on,
)
from balloon_warp.kernels.loops.bodies import Rigid, body_at, pushed_on, put_body, stop_function
from balloon_warp.kernels.loops.friction import friction_on, number_of_body
from balloon_warp.kernels.loops.inertia import inertia_function
from balloon_warp.kernels.params import params_functions
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.warps import block_barrier
from balloon_warp.kernels.working import Working


@cache
def pass_function(features: Features) -> Any:
    """Return the function by which a thread's particles meet a body in a pass."""
    _, read_params = params_functions(features.columns, features.balloons)
    inertia, stop_at = inertia_function(features), stop_function(features)

    @wp.func
    def pass_of_thread(
        t: Tables,
        working: Working,
        world: wp.int32,
        thread: wp.int32,
        rigid: Rigid,
        last: Change,
        change: Change,
        shift: wp.vec3,
        answers: bool,
        points: wp.array[wp.vec3],
        velocities: wp.array[wp.vec3],
    ):
        """Return the push of a thread's particles on a body with the last change, or apply a change to them."""
        part = Push()
        solid = t.bodies.solids[rigid.number]
        for particle in range(thread, points.shape[0], wp.block_dim()):
            end = points[particle]
            velocity = velocities[particle]
            stop = stop_at(
                solid, t.up, t.step_seconds, rigid, end - t.step_seconds * velocity, end, velocity, 0.0
            )  # fmt: skip
            pushed = wp.vec3()
            if wp.length_sq(stop.normal) > 0.0:
                params = read_params(t, world, particle)
                if params.share > 0.0:
                    mass = inertia(working, params)
                    if not answers:
                        part += push_of_particle(mass, stop.arm, stop.normal, stop.excess, stop.out, last)
                    else:
                        if gain_at(last, stop.arm, stop.normal) + stop.excess > 0.0:
                            gain = (gain_at(change, stop.arm, stop.normal) + stop.excess) * stop.normal
                            pushed = mass * gain
                            velocities[particle] = velocity + gain
                            end += t.step_seconds * gain
                        if stop.out > 0.0:
                            end += (wp.dot(stop.normal, shift) + stop.out) * stop.normal
                        points[particle] = end
            if answers:
                working.body_pushes[world, particle] = pushed
        return part

    return pass_of_thread


@cache
def rub_function(features: Features) -> Any:
    """Return the function by which a thread's particles rub on a body that they press."""
    _, read_params = params_functions(features.columns, features.balloons)
    inertia = inertia_function(features)

    @wp.func
    def rub_of_thread(
        t: Tables,
        working: Working,
        world: wp.int32,
        thread: wp.int32,
        rigid: Rigid,
        share: float,
        points: wp.array[wp.vec3],
        velocities: wp.array[wp.vec3],
    ):
        """Return the impulse of a thread's pressed particles on a body by friction [N s], and the torque's [N m s]."""
        total = wp.spatial_vector()
        center = rigid.end - t.step_seconds * rigid.velocity
        for particle in range(thread, points.shape[0], wp.block_dim()):
            pushed = working.body_pushes[world, particle]
            if wp.length_sq(pushed) > 0.0:
                params = read_params(t, world, particle)
                mass = inertia(working, params)
                velocity = velocities[particle]
                arm = points[particle] - t.step_seconds * velocity - center
                beside = velocity - rigid.velocity - wp.cross(rigid.spin, arm)
                friction = friction_on(t, world, params.balloon, number_of_body(t, rigid.number))
                rubbed = rub_on(beside, pushed, mass, share, friction)
                velocities[particle] = velocity + rubbed / mass
                points[particle] = points[particle] + (t.step_seconds / mass) * rubbed
                total -= wp.spatial_vector(rubbed, wp.cross(arm, rubbed))
        return total

    return rub_of_thread


@cache
def bodies_function(features: Features) -> Any:
    """Return the function by which bodies and particles exchange momentum, body by body, once all have moved."""
    pass_of_thread, rub_of_thread = pass_function(features), rub_function(features)

    @wp.func
    def touch_bodies(
        t: Tables,
        state: WorldState,
        working: Working,
        world: wp.int32,
        thread: wp.int32,
        points: wp.array[wp.vec3],
        velocities: wp.array[wp.vec3],
    ):
        """Resolve contacts of bodies with particles of a world, by all threads of a block."""
        for body in range(state.body_positions.shape[1]):
            rigid = body_at(t, state, working.body_starts, working.body_start_turns, world, body)
            tensor = rigid.mass * inertia_in_world(rigid.start_turn, t.bodies.inertias[body])
            last = Change()
            change = Change()
            shift = wp.vec3()
            push = Push()
            answers = bool(False)
            meets = bool(True)
            turn = wp.int32(0)
            while meets and turn <= MOST_TURNS:
                part = pass_of_thread(
                    t, working, world, thread, rigid, last, change, shift, answers, points, velocities
                )  # fmt: skip
                turn += 1
                if answers:
                    turn = MOST_TURNS + 1
                else:
                    push = wp.tile_sum(wp.tile(part, preserve_type=True))[0]
                    meets = turn > 1 or is_pushed(push)
                    if meets:
                        change = change_of_rigid(push, rigid.mass, tensor)
                        answers = turn == MOST_TURNS or is_same(change, last, rigid.reach)
                        if answers:
                            shift = shift_of_body(overlap_of(push), rigid.mass, t.up)
                        else:
                            last = change
            if meets:
                rigid = pushed_on(t, rigid, change.velocity, tensor * change.spin, shift)
                share = friction_share(rigid.mass, t.bodies.eases[body], rigid.reach, pressed_mass(push))
                rubbed = rub_of_thread(t, working, world, thread, rigid, share, points, velocities)
                rub = wp.tile_sum(wp.tile(rubbed, preserve_type=True))[0]
                nothing = wp.vec3()
                rigid = pushed_on(t, rigid, wp.spatial_top(rub) / rigid.mass, wp.spatial_bottom(rub), nothing)
                if thread == 0:
                    put_body(state, world, rigid)
                block_barrier()

    return touch_bodies
