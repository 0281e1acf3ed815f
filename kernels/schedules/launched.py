"""The pieces of a substep as kernels: a thread a particle, or a block a balloon where something is summed.

`scatter` and `gather` launch them one after the other; they differ in who sums the forces. Those of gas stand in
`launched_gas`.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.laws.gas import Swelling
from balloon_warp.kernels.laws.grip import Grip
from balloon_warp.kernels.loops.fixture_looks import is_free
from balloon_warp.kernels.loops.obstacles import around_function, obstacle_loop
from balloon_warp.kernels.memory import two_in
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.own import own_functions
from balloon_warp.kernels.schedules.fixed_point import add_quanta
from balloon_warp.kernels.schedules.later import put_off, turn_of
from balloon_warp.kernels.schedules.near import noting_function
from balloon_warp.kernels.substep import (
    drift_of,
    end_of_step,
    inflation_of,
    kick,
    load_once_burst,
    ramp_at,
    response,
)
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.traits import Traits


@wp.struct
class Working:
    """What a schedule keeps beside the state; arrays that a scene does not need are empty."""

    aims: wp.array2d[wp.vec3]
    """(A_p / A_total) n of each particle"""
    forces: wp.array2d[wp.vec3]
    """on each particle, where they are added up or shown [N]"""
    area_vectors: wp.array2d[wp.vec3]
    """of each particle [m^2]"""
    inflations: wp.array2d[wp.vec3]
    """on each particle, where corrections come between it and spheres [N]"""
    gas_masses: wp.array2d[float]
    """in each balloon [kg]"""
    swellings: wp.array3d[Swelling]
    """of each balloon in parts, where one has several"""
    sphere_quanta: wp.array3d[wp.int64]
    """forces on spheres since they last moved, see `fixed_point`; empty where momentum is exchanged"""
    sphere_starts: wp.array2d[wp.vec3]
    """where spheres were before this substep [m]; empty unless they may meet each other, or faces"""
    point_starts: wp.array2d[wp.vec3]
    """where particles were; empty unless spheres meet faces, as is the next"""
    lumps: wp.array2d[wp.int32]
    """particles of each world that go on together with a sphere, see `launched_faces`"""
    body_starts: wp.array2d[wp.vec3]
    """where free bodies were before this substep [m]; empty where there are none, as are the next three"""
    body_start_turns: wp.array2d[wp.quat]
    body_pushes: wp.array2d[wp.vec3]
    """what a body has pressed each particle with [N s]"""
    grips: wp.array2d[Grip]
    """what points of bodies meet in this substep"""
    near: wp.array2d[wp.int32]
    """whether particles may touch a sphere, see `launched_touch`; empty unless momentum is exchanged"""
    later: wp.array2d[wp.int32]
    """particles of each world that are put off, see `later`; empty where none are, as is the next"""
    later_counts: wp.array2d[wp.int32]
    """how many they are, in substeps of even and of odd numbers"""
    balloon_boxes: wp.array3d[wp.vec3]
    """around each balloon until the next search: lower and upper corner [m], and `PACE`; this and what follows is empty
    unless balloons touch, see `touch_boxes`"""
    sought: wp.array2d[wp.vec3]
    """where each particle was at the last search [m]"""
    part_boxes: wp.array2d[wp.vec4]
    """the same around each part of their surfaces, without `PACE`: shape (world_count, 2 part_count)"""
    neighbors: wp.array3d[wp.int32]
    """which each balloon may meet, perhaps itself: shape (world_count, balloon_count, balloon_count)"""
    neighbor_counts: wp.array2d[wp.int32]
    """how many they are"""
    near_balloons: wp.array2d[wp.int32]
    """what each balloon's particles do, and last what there is to do in the world"""
    candidate_counts: wp.array2d[wp.int32]
    """triangles that each particle may touch"""
    candidates: wp.array3d[wp.int32]
    """those triangles, see `touch_triangles.candidate_of`: shape (world_count, most, particle_count)"""
    particle_lists: wp.array3d[wp.int32]
    """those that look around, and those that have found something, see `touch_search`"""
    list_lengths: wp.array2d[wp.int32]
    """of both, and of all edges that may meet"""
    touch_quanta: wp.array3d[wp.int64]
    """forces of contacts on particles, which add up for ever, see `fixed_point.growth`: shape (world_count, 3,
    particle_count)"""
    touch_taken: wp.array3d[wp.int64]
    """how much of that particles have had"""
    contact_quanta: wp.array2d[wp.int64]
    """how many contacts particles have, in parts and for ever as forces do"""
    contacts_taken: wp.array2d[wp.int64]
    """how many of these have been counted"""
    contacts: wp.array2d[float]
    """how many they had in the substep before"""
    touched: wp.array2d[wp.int8]
    """what contacts have to do with each particle, see `launched_press`"""
    crowded: wp.array[wp.int32]
    """how often a triangle, or an edge, had no place in a list"""
    edge_candidates: wp.array3d[wp.int32]
    """edges that each may meet: shape (world_count, edges, most); empty unless sharp edges meet, see `launched_edges`,
    as is the next"""
    edge_counts: wp.array2d[wp.int32]
    """how many they are"""


@cache
def leaving_function(traits: Traits, puts_off: bool = False) -> Any:
    """The function by which a particle leaves obstacles; one that may exchange momentum waits for the others, see
    `launched_touch`.

    Args:
        puts_off: whether those are put off that may meet what goes where it is told, see `later`.
    """
    leave_obstacles = obstacle_loop(traits._replace(fixtures=traits.fixtures and not puts_off), add_quanta)
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
        if wp.static(puts_off):
            if not is_free(t, own.world, own.number, around.time, point):
                put_off(working.later, working.later_counts, own.world, own.number, turn_of(t, time_in_frame))
                return point, velocity
        out, after = leave_obstacles(t, state, working.sphere_quanta, around, point, velocity, inflation)
        return out, after

    return leave


@cache
def pushing_function(traits: Traits, puts_off: bool = False) -> Any:
    """The function that ends a particle's substep: the inflation, the movement, and obstacles.

    Args:
        puts_off: as in `leaving_function`.
    """
    inflation = inflation_of(traits)
    drift = drift_of(traits)
    leave = leaving_function(traits, puts_off)

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
        if wp.static(traits.bursts):
            load = load_once_burst(state, own.world, own.balloon, load)
        aim = wp.vec3()
        if wp.static(traits.aims):
            aim = working.aims[own.world, own.number]
        push = inflation(own.kind, value, load[0], load[1], t.up, point, aim, area_vector)
        velocity = kick(velocity, force + push, response(mass, t.step_seconds))
        point = drift(point, old_velocity, velocity, t.step_seconds)
        if wp.static(traits.keeps_inflations):
            working.inflations[own.world, own.number] = push
        if wp.static(traits.obstacles and not traits.corrected):
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
