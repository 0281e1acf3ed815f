"""Narrow phase: triangles that each particle may touch, searched every few substeps.

Each piece of a substep is a launch. They are found in the same order every time, and in each world by itself.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.contact.boxes import pad_function
from balloon_warp.kernels.contact.clearances import fastest_of, keep_clearance, lookout_of, pays_to_look_out
from balloon_warp.kernels.contact.may_be_near import FAR
from balloon_warp.kernels.contact.nearby import Nearby, Wanted, nearby_function
from balloon_warp.kernels.contact.sides import keep_side
from balloon_warp.kernels.contact.triangles import faced_triangle, relative_speed
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.loops.meeting import skin_functions
from balloon_warp.kernels.memory import vector_at
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.working import Working


@cache
def finding_functions(features: Features, eight: bool = False) -> Any:
    """Return the function that puts the triangles of a balloon that a particle may touch into its list."""
    pad_between = pad_function(features)
    thickness_between, _ = skin_functions(features)
    nearest_of = nearby_function(features, lists=False, eight=eight)
    list_those = nearby_function(features, lists=True, eight=eight)

    @wp.func
    def find_of_balloon(
        t: Tables, state: WorldState, working: Working, world: wp.int32, particle: wp.int32, balloon: wp.int32,
        other: wp.int32, points: wp.array[wp.vec3], velocities: wp.array[wp.vec3], may_be_deep: bool, count: wp.int32,
    ):  # fmt: skip
        """Add triangles of a balloon to a particle's list, and return its length.

        Args:
            may_be_deep: Whether the particle may be deep in the other balloon since the start.
        """
        hold = state.holds[world, particle][3]
        velocity = vector_at(velocities, particle)
        pad = pad_between(t, world, balloon, other)
        one_sided = other != balloon and t.touch.closed[other] == 1
        swept = t.touch.seconds * (wp.length(velocity) + fastest_of(working, world, other))
        within = pad + swept
        wanted = Wanted()
        wanted.within = within
        wanted.pad = FAR
        wanted.beside = wp.int32(-1)
        wanted.count = count
        if wp.static(features.touches_itself):
            if other == balloon:
                if pays_to_look_out(t, working, world, balloon):
                    wanted.within = within + lookout_of(t, balloon)
                else:
                    wanted.pad = pad
        looks_deep = one_sided and (may_be_deep or wp.abs(hold) > t.touch.slack[balloon])
        found = Nearby()
        found.nearest = wp.int32(-1)
        while found.nearest < 0 and wanted.within > 0.0:
            found = nearest_of(t, working, world, particle, balloon, other, points, velocities, wanted)
            wanted.within = wp.where(looks_deep and t.touch.depth[other] > wanted.within, t.touch.depth[other], 0.0)
        if wp.static(features.touches_itself):
            if other == balloon:
                distance = wp.sqrt(found.place.squared)
                keep_clearance(working, world, balloon, particle, wp.where(wanted.pad == FAR, distance, 0.0))
                found.nearest = wp.where(distance > within, -1, found.nearest)
        if found.nearest >= 0:
            place = faced_triangle(t, points, found.nearest, found.place)
            side = float(1.0)
            deepest = t.touch.depth[other]
            crossed = bool(False)
            if not one_sided:
                deepest = thickness_between(t, world, balloon, other)
                side = wp.where(hold < 0.0 or (hold == 0.0 and place.gap < 0.0), -1.0, 1.0)
                if wp.static(features.touches_itself):
                    side = wp.where(place.gap < 0.0, -1.0, 1.0)
                    crossed = side * hold < 0.0 and wp.abs(place.gap) < deepest
            comes = t.touch.seconds * relative_speed(t, velocities, found.nearest, velocity)
            if one_sided and may_be_deep and place.gap < 0.0:
                state.deep[world, particle] = wp.int8(1)  # until it is out
            if side * place.gap < pad + comes and side * place.gap > -deepest:
                wanted.within = wp.sqrt(place.squared) + pad + 2.0 * comes
                wanted.pad = FAR
                wanted.behind = side < 0.0
                if wp.static(features.touches_itself):
                    wanted.beside = wp.where(one_sided, -1, found.nearest)
                listed = list_those(t, working, world, particle, balloon, other, points, velocities, wanted)
                if wp.static(features.touches_itself):
                    if crossed:
                        begin, end = count, wp.min(listed.count, working.candidates.shape[2])
                        keep_side(t, working, world, particle, found.nearest, hold, deepest, points, begin, end)
                count = listed.count
        return count

    return find_of_balloon
