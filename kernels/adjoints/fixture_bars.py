"""Derivatives by the places of obstacles, and by the friction on them: those of particles, and their sums."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.loops.fixtures import Around, seconds_in_frame
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.working import FixtureBars, Working

WIDTH = 7
"""Numbers of `FixtureBars`"""
Totals = wp.types.vector(length=WIDTH, dtype=wp.float64)
"""Sums of `FixtureBars`"""


@cache
def fixture_bars_function(features: Features) -> Any:
    """Return the function that notes the bars of an obstacle by a particle's contact, where they are asked for."""

    @wp.func
    def part_of_frame(t: Tables, time: float):
        return seconds_in_frame(t, time) / t.frame_seconds

    @wp.func
    def note_fixture(
        t: Tables, working: Working, around: Around, fixture: wp.int32, by_center: wp.vec3, by_velocity: wp.vec3,
        by_center_before: wp.vec3, by_friction: float,
    ):  # fmt: skip
        """Add to the bars of an obstacle.

        Args:
            by_center: bar of its place as the substep ends, between those of the frame's beginning and end.
            by_velocity: bar of its velocity, which follows from both.
            by_center_before: bar of its place as the substep begins.
        """
        if working.fixture_bars.shape[1] > 0:
            at_last = wp.vec3()
            if wp.static(features.fixtures_move):
                at_last = (
                    part_of_frame(t, around.time) * by_center
                    + part_of_frame(t, around.time - t.step_seconds) * by_center_before
                    + by_velocity / t.frame_seconds
                )
            at_first = by_center + by_center_before - at_last
            more = FixtureBars(at_first[0], at_first[1], at_first[2], at_last[0], at_last[1], at_last[2], by_friction)
            before = working.fixture_bars[around.world, around.particle, fixture]
            working.fixture_bars[around.world, around.particle, fixture] = before + more

    return note_fixture


@wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
def sum_fixture_bars(t: Tables, working: Working, totals: wp.array3d[Totals]):
    """Add up an obstacle's bars by a balloon's particles, and clear them; a thread a (world, balloon, obstacle)."""
    world, balloon, fixture = wp.tid()
    total = Totals()
    for particle in range(t.particles.offsets[balloon], t.particles.offsets[balloon + 1]):
        total += Totals(working.fixture_bars[world, particle, fixture])
        working.fixture_bars[world, particle, fixture] = FixtureBars()
    totals[world, balloon, fixture] = total
