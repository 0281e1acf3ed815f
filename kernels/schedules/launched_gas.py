"""The pieces of a substep with gas as kernels: a thread a world, or a block a balloon whose particles are summed."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.laws.gas import Swelling
from balloon_warp.kernels.laws.inflation import GAS, NORMAL_FORCE, PRESSURE
from balloon_warp.kernels.loops.emptying import holding_function
from balloon_warp.kernels.loops.gas import flows_function, gas_mass_function, pump_function
from balloon_warp.kernels.loops.obstacles import around_function, sphere_in_state
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.own import numbers_reader, own_functions
from balloon_warp.kernels.schedules.launched import inertia_function
from balloon_warp.kernels.schedules.working import Working
from balloon_warp.kernels.substep import (
    end_of_step,
    load_function,
    memory_function,
    note_function,
    ramp_at,
    response,
    swell_function,
    time_of,
    volume_origin,
)
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.traits import Traits

PARTICLES_OF_PART = wp.constant(512)
"""of a large balloon, which a block sums"""
LARGE = 2048
"""particles of a balloon that is summed in parts"""


@cache
def pump_kernel(traits: Traits) -> Any:
    """The kernel that begins a substep of balloons with gas, or a frame where their gas stays as it is."""
    pump_gas = pump_function(traits)
    gas_mass = gas_mass_function(traits)

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def pump_gases(
        # model
        t: Tables,
        time_in_frame: float,
        # state in and out
        state: WorldState,
        # out
        working: Working,
    ):
        """A thread a world: what is pumped in or let out, and the masses of gas."""
        world = wp.tid()
        pump_gas(t, state, world, time_in_frame, time_of(t, state.frame, time_in_frame))
        for balloon in range(t.inflation_kind.shape[0]):
            working.gas_masses[world, balloon] = gas_mass(t, state, world, balloon)

    return pump_gases


@cache
def flow_kernel(traits: Traits) -> Any:
    """The kernel that lets gas flow through tubes, necks and leaks."""
    flow_through_all = flows_function(traits)

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def let_gases_flow(
        # model
        t: Tables,
        time_in_frame: float,
        # state in and out
        state: WorldState,
    ):
        """A thread a world, once the loads are known that were without."""
        flow_through_all(t, state, wp.tid(), time_of(t, state.frame, time_in_frame))

    return let_gases_flow


@cache
def summing_function(traits: Traits) -> Any:
    """The function that sums how a thread's particles swell their balloon."""
    _, read_own = own_functions(traits.columns, traits.balloons)
    swell = swell_function(traits, sphere_in_state)
    remembered = memory_function(traits)
    inertia = inertia_function(traits)
    around_own = around_function(traits)

    @wp.func
    def swelling_of_thread(
        t: Tables,
        state: WorldState,
        working: Working,
        points: wp.array2d[wp.vec3],
        velocities: wp.array2d[wp.vec3],
        free_velocities: wp.array2d[wp.vec3],
        time_in_frame: float,
        world: wp.int32,
        balloon: wp.int32,
        begin: wp.int32,
        end: wp.int32,
    ):
        """Of those from one to another, every block_dim-th."""
        part = Swelling()
        if t.inflation_kind[balloon] != NORMAL_FORCE:
            origin = points[world, volume_origin(t, balloon)]
            time = end_of_step(t, state.frame, time_in_frame)
            for particle in range(begin, end, wp.block_dim()):
                own = read_own(t, world, particle)
                point = points[world, particle]
                part += swell(
                    t, state, around_own(own, time), own.share, response(inertia(working, own), t.step_seconds),
                    state.inflation_loads[world, balloon], point - origin, point, free_velocities[world, particle],
                    remembered(velocities[world, particle], own.n), working.area_vectors[world, particle],
                )  # fmt: skip
        return part

    return swelling_of_thread


@cache
def swelling_kernel(traits: Traits) -> Any:
    """The kernel that sums how large balloons would swell, part by part."""
    swelling_of_thread = summing_function(traits)

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def sum_swellings(
        # model
        t: Tables,
        time_in_frame: float,
        # state in
        points: wp.array2d[wp.vec3],
        velocities: wp.array2d[wp.vec3],
        free_velocities: wp.array2d[wp.vec3],
        # state in and out
        state: WorldState,
        # out
        working: Working,
    ):
        """A block a (world, balloon, part), summed in the same order every time."""
        world, balloon, part, thread = wp.tid()
        begin = t.particles.offsets[balloon] + part * PARTICLES_OF_PART
        end = wp.min(begin + PARTICLES_OF_PART, t.particles.offsets[balloon + 1])
        of_thread = swelling_of_thread(
            t, state, working, points, velocities, free_velocities, time_in_frame, world, balloon, begin + thread, end
        )
        swelling = wp.tile_sum(wp.tile(of_thread, preserve_type=True))[0]
        if thread == 0:
            working.swellings[world, balloon, part] = swelling

    return sum_swellings


@cache
def load_kernel(traits: Traits, in_parts: bool) -> Any:
    """The kernel that finds the pressures of balloons, from how they would swell without them.

    Args:
        in_parts: whether that has been summed in parts.
    """
    swelling_of_thread = summing_function(traits)
    read_numbers = numbers_reader(traits.columns)
    load_of_balloon = load_function(traits)
    note_load = note_function(traits)
    holds_gas = holding_function(traits)

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def find_loads(
        # model
        t: Tables,
        time_in_frame: float,
        # state in
        points: wp.array2d[wp.vec3],
        velocities: wp.array2d[wp.vec3],
        free_velocities: wp.array2d[wp.vec3],
        # state in and out
        state: WorldState,
        working: Working,
    ):
        """A block a (world, balloon): its swelling, summed in the same order every time, and the load that follows."""
        world, balloon, thread = wp.tid()
        of_thread = Swelling()
        if wp.static(in_parts):
            for part in range(thread, working.swellings.shape[2], wp.block_dim()):
                of_thread += working.swellings[world, balloon, part]
        else:
            begin = t.particles.offsets[balloon] + thread
            of_thread = swelling_of_thread(
                t, state, working, points, velocities, free_velocities, time_in_frame, world, balloon, begin,
                t.particles.offsets[balloon + 1],
            )  # fmt: skip
        swelling = wp.tile_sum(wp.tile(of_thread, preserve_type=True))[0]
        kind = t.inflation_kind[balloon]
        if thread == 0 and kind != NORMAL_FORCE:
            given = ramp_at(state, world, balloon, time_in_frame)
            if wp.static(traits.bursts):
                if holds_gas(t, state, world, balloon):
                    kind = GAS
                elif state.bursts[world, balloon][0] >= 0.0:
                    kind = PRESSURE
                    given = 0.0  # it is open
            load = load_of_balloon(
                kind, given, swelling,
                float(state.gas_amounts[world, balloon]), float(state.free_volumes[world, balloon]), t.step_seconds,
                read_numbers(t, world, balloon),
            )  # fmt: skip
            note_load(state, world, balloon, load)

    return find_loads
