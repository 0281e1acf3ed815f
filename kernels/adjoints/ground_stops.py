"""Adjoint of the ground, which stops particles that contacts push into it: how is noted in each sweep.

Frozen is which particles it stops, and whether it takes all of their speed.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.contact.ends import stop_by_ground
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.warps import block_barrier
from balloon_warp.kernels.working import Working


@wp.func
def note_stop(working: Working, world: wp.int32, particle: wp.int32, rise: float, fall: float):
    """Note how the ground stops a particle in this sweep."""
    working.contact_stops[world, particle] = wp.vec2(rise, fall)


@wp.func
def forget_stops(working: Working, world: wp.int32, thread: wp.int32, count: wp.int32):
    """Clear the stops of the ends of all contacts."""
    if working.contact_stops.shape[1] > 0:
        for place in range(thread, count, wp.block_dim()):
            ends = working.catches[world, place].ends
            for end in range(4):
                working.contact_stops[world, ends[end]] = wp.vec2()
        block_barrier()


@wp.func
def keep_stops(working: Working, bars: Any, world: wp.int32, thread: wp.int32, count: wp.int32, sweep: wp.int32):
    """Keep the stops that a sweep has noted of the ends of all contacts."""
    if working.contact_stops.shape[1] > 0:
        for place in range(thread, count, wp.block_dim()):
            ends = working.catches[world, place].ends
            for end in range(4):
                stop = working.contact_stops[world, ends[end]]
                bars.rises[sweep, world, ends[end]] = stop[0]
                bars.falls[sweep, world, ends[end]] = stop[1]
        block_barrier()


@wp.func
def work_of_stop(rise: float, fall: float, step_seconds: float, by_place: float, by_speed: float):
    """Return the rise of a particle and the gain of its speed, times their bars."""
    return rise * by_place + stop_by_ground(rise, fall, step_seconds) * by_speed


@cache
def stops_function(features: Features, columns: tuple[int, ...]) -> Any:
    """Return the function that runs the ground's stops of a sweep backwards, by all threads of a block.

    Args:
        columns: of the numbers that are derived by.
    """
    column = features.columns.places["ground_height"]
    place_of_height = columns.index(column) if column in columns else -1

    @wp.func
    def stop_back(t: Tables, bars: Any, world: wp.int32, particle: wp.int32, rise: float, fall: float, speeds: float):
        place = bars.points[world, particle]
        velocity = bars.velocities[world, particle]
        by_rise, by_fall, _step, _place, _speed = wp.grad(work_of_stop)(
            rise, fall, t.step_seconds, wp.dot(place, t.up), speeds * wp.dot(velocity, t.up)
        )
        bars.points[world, particle] = place - by_rise * t.up
        if fall < 0.0:
            bars.velocities[world, particle] = velocity + by_fall * t.up
        if wp.static(place_of_height >= 0):
            before = bars.numbers[world, particle, wp.static(place_of_height)]
            bars.numbers[world, particle, wp.static(place_of_height)] = before + by_rise

    @wp.func
    def stops_back(
        t: Tables, working: Working, bars: Any, world: wp.int32, thread: wp.int32, count: wp.int32, sweep: wp.int32,
        speeds: float,
    ):  # fmt: skip
        """Run the stops of a sweep backwards.

        Args:
            speeds: 1, or 0 where particles were moved without speed.
        """
        if wp.static(features.ground):
            for place in range(thread, count, wp.block_dim()):
                ends = working.catches[world, place].ends
                for end in range(4):
                    rise = wp.atomic_exch(bars.rises, sweep, world, ends[end], 0.0)  # who comes first
                    if rise > 0.0:
                        stop_back(t, bars, world, ends[end], rise, bars.falls[sweep, world, ends[end]], speeds)
            block_barrier()

    return stops_back
