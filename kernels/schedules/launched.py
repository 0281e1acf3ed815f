"""The pieces of a substep as kernels: a thread a particle, or a block a balloon where something is summed.

`scatter` and `gather` launch them one after the other; they differ in who sums the forces. Those of gas stand in
`launched_gas`.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.loops.obstacles import around_function, obstacle_loop
from balloon_warp.kernels.memory import two_in
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.own import own_functions
from balloon_warp.kernels.schedules.fixed_point import add_quanta
from balloon_warp.kernels.schedules.later import later_functions
from balloon_warp.kernels.schedules.near import noting_function
from balloon_warp.kernels.schedules.pushes import pushed
from balloon_warp.kernels.schedules.working import Working
from balloon_warp.kernels.substep import (
    drift_of,
    end_of_step,
    inflation_of,
    kick,
    ramp_at,
    response,
)
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.traits import Traits


@cache
def leaving_function(traits: Traits) -> Any:
    """The function by which a particle leaves obstacles; one that may exchange momentum waits for the others, see
    `launched_touch`."""
    leave_obstacles = obstacle_loop(traits, add_quanta)
    is_noted = noting_function(traits)
    around_own = around_function(traits)

    @wp.func
    def leave(
        t: Tables,
        state: WorldState,
        working: Working,
        own: Any,
        time_in_frame: float,
        point: wp.vec3,
        velocity: wp.vec3,
        inflation: wp.vec3,
    ):
        """Point and velocity outside, at the end of the substep that begins at a time."""
        if wp.static(traits.impulses):
            if is_noted(t, state, working.near, own.world, own.number, point, velocity):
                return point, velocity
        around = around_own(own, end_of_step(t, state.frame, time_in_frame))
        out, after = leave_obstacles(t, state, working.sphere_quanta, around, point, velocity, inflation)
        return out, after

    return leave


@cache
def pushing_function(traits: Traits, puts_off: bool = False) -> Any:
    """The function that ends a particle's substep: the inflation, the movement, contacts, and obstacles.

    Args:
        puts_off: whether it is put off where it has anything to do with the last two, see `later`, and moves here as if
            it had not.
    """
    inflation = inflation_of(traits)
    drift = drift_of(traits)
    may_stand, _, _ = later_functions(traits)
    leave = leaving_function(traits)

    @wp.func
    def push_and_move(
        t: Tables,
        state: WorldState,
        working: Working,
        own: Any,
        mass: float,
        force: wp.vec3,
        area_vector: wp.vec3,
        point: wp.vec3,
        old_velocity: wp.vec3,
        velocity: wp.vec3,
        time_in_frame: float,
    ):
        """Point and velocity at the end of the substep.

        Args:
            force: the other forces, so far as they are not in the velocity yet.
            old_velocity: before the substep, by which forward Euler moves.
        """
        value = ramp_at(state, own.world, own.balloon, time_in_frame)
        load = two_in(state.inflation_loads, own.world, own.balloon)
        if wp.static(not traits.gas):
            load = wp.vec2(value, 0.0)  # a given pressure
        aim = wp.vec3()
        if wp.static(traits.aims):
            aim = working.aims[own.world, own.number]
        push = inflation(own.kind, value, load[0], load[1], t.up, point, aim, area_vector)
        gain = response(mass, t.step_seconds)
        velocity = kick(velocity, force + push, gain)
        if wp.static(traits.keeps_inflations):
            working.inflations[own.world, own.number] = push
        if wp.static(traits.pushes_come_last and not puts_off):
            velocity = pushed(working, own, gain, velocity)
        point = drift(point, old_velocity, velocity, t.step_seconds)
        if wp.static(puts_off and traits.stands):
            near = may_stand(t, own, end_of_step(t, state.frame, time_in_frame), point)
            working.near_solids[own.world, own.number] = wp.where(near, wp.int8(1), wp.int8(0))
        elif wp.static(not puts_off and traits.obstacles and not traits.corrected):
            if mass > 0.0:
                out, after = leave(t, state, working, own, time_in_frame, point, velocity, push)
                point = out
                velocity = after
        return point, velocity

    return push_and_move


@cache
def inertia_function(traits: Traits) -> Any:
    """The function that gives a particle's mass and its share of the gas, which moves along [kg]; 0 if it is fixed."""

    @wp.func
    def inertia(working: Working, own: Any):
        if wp.static(traits.gas):
            return own.mass + own.share * working.gas_masses[own.world, own.balloon]
        else:
            return own.mass

    return inertia


@cache
def ease_function(traits: Traits) -> Any:
    """The function that gives 1 over what a particle moves [1/kg], 0 if it is fixed."""
    _, read_own = own_functions(traits.columns, traits.balloons)
    inertia = inertia_function(traits)

    @wp.func
    def ease_of_moving(t: Tables, working: Working, world: wp.int32, particle: wp.int32):
        mass = inertia(working, read_own(t, world, particle))
        return wp.where(mass > 0.0, 1.0 / mass, 0.0)

    return ease_of_moving


@cache
def leave_kernel(traits: Traits) -> Any:
    """The kernel by which particles leave obstacles after a correction."""
    _, read_own = own_functions(traits.columns, traits.balloons)
    leave = leaving_function(traits)

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def leave_after_correction(
        # model
        t: Tables,
        time_in_frame: float,
        # state in and out
        state: WorldState,
        working: Working,
        points: wp.array2d[wp.vec3],
        velocities: wp.array2d[wp.vec3],
    ):
        """A thread a (world, particle)."""
        world, particle = wp.tid()
        own = read_own(t, world, particle)
        if own.share > 0.0:
            push = wp.vec3()
            if wp.static(traits.keeps_inflations):
                push = working.inflations[world, particle]
            point, velocity = leave(
                t, state, working, own, time_in_frame, points[world, particle], velocities[world, particle], push
            )
            points[world, particle] = point
            velocities[world, particle] = velocity

    return leave_after_correction


@cache
def kernel_of_worlds(act: Any) -> Any:
    """A kernel in which each world has a block, whose threads all do what a function says."""

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def act_in_worlds(
        # model
        t: Tables,
        # state in and out
        state: WorldState,
        working: Working,
        points: wp.array2d[wp.vec3],
        velocities: wp.array2d[wp.vec3],
    ):
        """A block a world."""
        world, thread = wp.tid()
        act(t, state, working, world, thread, points[world], velocities[world])

    return act_in_worlds
