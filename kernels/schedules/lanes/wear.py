"""Membranes that soften, in lanes: what is left of the tensions of a quad's triangles, found where these are."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.algebra import LANE_COUNT, Lanes, Lanes4, of_lane, times
from balloon_warp.kernels.contact.free_frames import FREE
from balloon_warp.kernels.loops.membranes import material_reader
from balloon_warp.kernels.loops.wear import wear_of_triangle
from balloon_warp.kernels.schedules.lanes.layouts import Layout, places_of
from balloon_warp.kernels.schedules.lanes.tables import lane_structs
from balloon_warp.kernels.tables import WorldState
from balloon_warp.kernels.traits import Traits


@cache
def wear_quad_function(traits: Traits, layout: Layout) -> Any:
    """The function that makes the tensions of a quad's triangles, or of eight, what is left of them."""
    LaneTables, LaneState, _ = lane_structs(layout)  # noqa: N806 - types
    places, material_of = places_of(layout), material_reader(traits)
    wear = wear_of_triangle(traits)

    @wp.func
    def wear_quad(
        t: LaneTables,
        lanes: LaneState,
        group: wp.int32,
        balloon: wp.int32,
        entry: wp.int32,
        d11: Lanes4,
        d12: Lanes4,
        along: Lanes4,
        mixed: Lanes4,
        back: Lanes4,
    ):
        """By the products of the quad's edges."""
        n = lanes.numbers[group, balloon]
        material = material_of(t.all.membranes, balloon)
        for corner in range(t.quad_triangles[entry]):
            e11 = d11[corner]
            e12 = d12[corner]
            e22 = d11[(corner + 3) % 4]
            rests = t.quad_rests[4 * entry + corner]
            peaks = lanes.peaks[group, 4 * entry + corner]
            left = Lanes()
            for lane in range(LANE_COUNT):
                world = places.world(group, lane, t.world_count)
                metric = wp.vec3(e11[lane], e12[lane], e22[lane])
                of_one, greatest, _stress = wear(
                    t.all, world, balloon, material, metric, of_lane(rests, lane), peaks[lane], n, lane
                )
                left[lane] = of_one
                peaks[lane] = greatest
            lanes.peaks[group, 4 * entry + corner] = peaks
            along[corner] = times(along[corner], left)
            mixed[corner] = times(mixed[corner], left)
            back[(corner + 3) % 4] = times(back[(corner + 3) % 4], left)
        return along, mixed, back

    return wear_quad


@cache
def peaks_functions(traits: Traits, layout: Layout) -> tuple[Any, Any]:
    """The functions that read what triangles have borne as a frame begins, and that write it as it ends."""
    LaneTables, LaneState, _ = lane_structs(layout)  # noqa: N806 - types
    places = places_of(layout)

    @wp.func
    def read_peaks(t: LaneTables, state: WorldState, lanes: LaneState, group: wp.int32):
        for entry in range(t.quad_numbers.shape[0]):
            for lane in range(t.lane_count):
                number = of_lane(t.quad_numbers[entry], lane)
                if number >= 0:
                    world = places.world(group, lane, t.world_count)
                    lanes.peaks[group, entry][lane] = state.peaks[world, number]

    @wp.func
    def write_peaks(t: LaneTables, state: WorldState, lanes: LaneState, group: wp.int32):
        for entry in range(t.quad_numbers.shape[0]):
            for lane in range(t.lane_count):
                number = of_lane(t.quad_numbers[entry], lane)
                world = places.world(group, lane, t.world_count)
                ends = number >= 0 and places.is_other(group, lane, t.world_count)
                if wp.static(traits.frames == "free"):
                    ends = ends and lanes.free.verdicts[world] == FREE
                if ends:
                    state.peaks[world, number] = lanes.peaks[group, entry][lane]

    return read_peaks, write_peaks
