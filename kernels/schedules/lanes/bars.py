"""Transfer of bars into the lanes as a frame begins to run backwards, and back; and the parameters of an item."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.algebra import times
from balloon_warp.kernels.lanes import Lanes, Lanes2, Lanes3, Lanes4, of_lane, set_lane
from balloon_warp.kernels.schedules.lanes.layouts import Layout, of_item, put_item
from balloon_warp.kernels.schedules.lanes.places import places_of
from balloon_warp.kernels.schedules.lanes.tables import lane_structs


@wp.func
def load_in(noted: Lanes4):
    """Return the pressures at height 0 [Pa], and their rises with height [Pa/m], of the note of a gas."""
    load = Lanes2()
    load[0] = noted[1]
    load[1] = noted[2]
    return load


@cache
def bar_functions(layout: Layout) -> tuple[Any, Any]:
    """Return the functions that read the bars of where a frame ends, and that write those of where it begins."""
    LaneTables, places = lane_structs(layout).tables, places_of(layout)  # noqa: N806 - a type

    @wp.func
    def read_of_item(t: LaneTables, group: wp.int32, item: wp.int32, bars: wp.array2d[wp.vec3]):
        """Return the bars of an item, zero in lanes that hold nothing of their own."""
        bar = Lanes3()
        for lane in range(t.lane_count):
            if places.is_there(t, group, item, lane):
                world = places.world(group, lane, t.world_count)
                bar = set_lane(bar, lane, bars[world, places.particle(t, item, lane)])
        return bar

    @wp.func
    def write_of_item(t: LaneTables, group: wp.int32, item: wp.int32, bars: wp.array2d[wp.vec3], bar: Lanes3):
        """Write the bars of an item."""
        for lane in range(t.lane_count):
            if places.is_there(t, group, item, lane):
                world = places.world(group, lane, t.world_count)
                bars[world, places.particle(t, item, lane)] = of_lane(bar, lane)

    @wp.func
    def read_bars(
        t: LaneTables, group: wp.int32, all_point_bar: wp.array2d[wp.vec3], all_velocity_bar: wp.array2d[wp.vec3],
        point_bars: Any, velocity_bars: Any,
    ):  # fmt: skip
        for item in range(t.item_offsets[0], t.item_offsets[1]):
            put_item(point_bars, item, read_of_item(t, group, item, all_point_bar))
            put_item(velocity_bars, item, read_of_item(t, group, item, all_velocity_bar))

    @wp.func
    def write_bars(
        t: LaneTables, group: wp.int32, all_point_bar: wp.array2d[wp.vec3], all_velocity_bar: wp.array2d[wp.vec3],
        point_bars: Any, velocity_bars: Any,
    ):  # fmt: skip
        for item in range(t.item_offsets[0], t.item_offsets[1]):
            write_of_item(t, group, item, all_point_bar, of_item(point_bars, item))
            write_of_item(t, group, item, all_velocity_bar, of_item(velocity_bars, item))

    return read_bars, write_bars


@cache
def own_function(mass: int, layout: Layout) -> Any:
    """Return the function that reads the parameters of an item, without the numbers of its balloon.

    Args:
        mass: column of the mass.
    """
    LaneTables, Number = lane_structs(layout).tables, layout.number  # noqa: N806 - types

    @wp.struct
    class LaneOwn:
        """Indices, share and mass of an item: a type by which phases are derived has no arrays."""

        group: wp.int32
        number: wp.int32
        balloon: wp.int32
        kind: wp.int32
        share: Number
        mass: Lanes

    @wp.func
    def own_of(t: LaneTables, group: wp.int32, balloon: wp.int32, item: wp.int32):
        own = LaneOwn()
        own.group = group
        own.number = item
        own.balloon = balloon
        own.kind = t.all.inflation_kind[balloon]
        own.share = t.shares[item]
        own.mass = times(own.share, t.numbers[group, balloon, mass])
        return own

    return own_of
