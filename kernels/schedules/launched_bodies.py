"""Free rigid bodies and the particles that they meet, where each piece of a substep is a launch: a block a world, which
goes through its particles in the same order every time."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.laws.contact import friction_on
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
    push_of_particle,
    rub_on,
)
from balloon_warp.kernels.loops.bodies import Rigid, body_at, pushed_on, put_body, stop_function
from balloon_warp.kernels.loops.tumbling import tumbling_function
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.own import own_functions
from balloon_warp.kernels.schedules.launched import inertia_function
from balloon_warp.kernels.schedules.warps import block_barrier
from balloon_warp.kernels.schedules.working import Working
from balloon_warp.kernels.substep import end_of_step
from balloon_warp.kernels.tables import Tables, WorldState, row_of_world
from balloon_warp.kernels.traits import Traits


@cache
def tumble_kernel(traits: Traits) -> Any:
    """The kernel that moves bodies, before they meet particles."""
    tumble = tumbling_function(traits)

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def tumble_bodies(
        # model
        t: Tables,
        time_in_frame: float,
        # state in and out
        state: WorldState,
        working: Working,
    ):
        """A thread a world."""
        world = wp.tid()
        tumble(t, state, working, world, end_of_step(t, state.frame, time_in_frame) - t.step_seconds)

    return tumble_bodies


@cache
def bodies_function(traits: Traits) -> Any:
    """The function by which bodies and particles exchange momentum, body by body, once all have moved."""
    _, read_own = own_functions(traits.columns, traits.balloons)
    inertia = inertia_function(traits)
    stop_at = stop_function(traits)
    friction_column = traits.columns.places["balloon_friction"]

    @wp.func
    def push_of_thread(
        t: Tables,
        working: Working,
        world: wp.int32,
        thread: wp.int32,
        rigid: Rigid,
        last: Change,
        points: wp.array[wp.vec3],
        velocities: wp.array[wp.vec3],
    ):
        """By the particles that are a thread's."""
        part = Push()
        for particle in range(thread, points.shape[0], wp.block_dim()):
            end = points[particle]
            velocity = velocities[particle]
            stop = stop_at(t, rigid, end - t.step_seconds * velocity, end, velocity, 0.0)
            if wp.length_sq(stop.normal) > 0.0:
                own = read_own(t, world, particle)
                if own.share > 0.0:
                    mass = inertia(working, own)
                    part += push_of_particle(mass, stop.arm, stop.normal, stop.excess, stop.out, last)
        return part

    @wp.func
    def answer_of_thread(
        t: Tables,
        working: Working,
        world: wp.int32,
        thread: wp.int32,
        rigid: Rigid,
        last: Change,
        change: Change,
        shift: wp.vec3,
        points: wp.array[wp.vec3],
        velocities: wp.array[wp.vec3],
    ):
        """What they gain; and the mass of those that are pressed [kg]."""
        pressed = float(0.0)
        for particle in range(thread, points.shape[0], wp.block_dim()):
            end = points[particle]
            velocity = velocities[particle]
            stop = stop_at(t, rigid, end - t.step_seconds * velocity, end, velocity, 0.0)
            pushed = wp.vec3()
            if wp.length_sq(stop.normal) > 0.0 and t.particles.mass_share[particle] > 0.0:
                if gain_at(last, stop.arm, stop.normal) + stop.excess > 0.0:
                    mass = inertia(working, read_own(t, world, particle))
                    gain = (gain_at(change, stop.arm, stop.normal) + stop.excess) * stop.normal
                    pressed += mass
                    pushed = mass * gain
                    velocities[particle] = velocity + gain
                    end += t.step_seconds * gain
                if stop.out > 0.0:
                    end += (wp.dot(stop.normal, shift) + stop.out) * stop.normal
                points[particle] = end
            working.body_pushes[world, particle] = pushed
        return pressed

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
        """Friction on those that are pressed; the impulse on the body [N s], and its torque's [N m s]."""
        total = wp.spatial_vector()
        its = t.bodies.friction[row_of_world(world, t.bodies.friction.shape[0]), rigid.number]
        center = rigid.end - t.step_seconds * rigid.velocity
        for particle in range(thread, points.shape[0], wp.block_dim()):
            pushed = working.body_pushes[world, particle]
            if wp.length_sq(pushed) > 0.0:
                own = read_own(t, world, particle)
                mass = inertia(working, own)
                velocity = velocities[particle]
                arm = points[particle] - t.step_seconds * velocity - center
                beside = velocity - rigid.velocity - wp.cross(rigid.spin, arm)
                friction = friction_on(own.n[friction_column], its)
                rubbed = rub_on(beside, pushed, mass, share, friction)
                velocities[particle] = velocity + rubbed / mass
                points[particle] = points[particle] + (t.step_seconds / mass) * rubbed
                total -= wp.spatial_vector(rubbed, wp.cross(arm, rubbed))
        return total

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
        """Of a world, by all threads of a block."""
        for body in range(state.body_positions.shape[1]):
            rigid = body_at(t, state, working.body_starts, working.body_start_turns, world, body)
            last = Change()
            part = push_of_thread(t, working, world, thread, rigid, last, points, velocities)
            push = wp.tile_sum(wp.tile(part, preserve_type=True))[0]
            if is_pushed(push):
                tensor = rigid.mass * inertia_in_world(rigid.start_turn, t.bodies.inertias[body])
                change = change_of_rigid(push, rigid.mass, tensor)
                turn = wp.int32(1)
                while turn < MOST_TURNS and not is_same(change, last, rigid.reach):
                    last = change
                    part = push_of_thread(t, working, world, thread, rigid, last, points, velocities)
                    push = wp.tile_sum(wp.tile(part, preserve_type=True))[0]
                    change = change_of_rigid(push, rigid.mass, tensor)
                    turn += 1
                shift = shift_of_body(overlap_of(push), rigid.mass, t.up)
                mine = answer_of_thread(t, working, world, thread, rigid, last, change, shift, points, velocities)
                pressed = wp.tile_sum(wp.tile(mine))[0]
                rigid = pushed_on(t, rigid, change.velocity, tensor * change.spin, shift)
                share = friction_share(rigid.mass, t.bodies.eases[body], rigid.reach, pressed)
                rubbed = rub_of_thread(t, working, world, thread, rigid, share, points, velocities)
                rub = wp.tile_sum(wp.tile(rubbed, preserve_type=True))[0]
                nothing = wp.vec3()
                rigid = pushed_on(t, rigid, wp.spatial_top(rub) / rigid.mass, wp.spatial_bottom(rub), nothing)
                if thread == 0:
                    put_body(state, world, rigid)
                block_barrier()

    return touch_bodies
