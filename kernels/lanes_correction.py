"""Position correction in eight worlds side by side."""

import warp as wp

from balloon_warp.kernels.correction import excess, moves_of_ends
from balloon_warp.kernels.lanes_state import CORRECTION_LIMIT, LaneState
from balloon_warp.kernels.lanes_types import LANE_COUNT, Lanes, Lanes3, column, set_column, squared_lengths
from balloon_warp.kernels.tables import BodyTable, CorrectionTable


@wp.func
def may_be_too_long(d: Lanes3, rest_length: float, limits: Lanes):
    """Whether a spring may be too long in any of the worlds: without fail if it is, whatever the others are."""
    beyond = squared_lengths(d)
    for lane in range(LANE_COUNT):
        longest = (1.0 + limits[lane]) * rest_length
        beyond[lane] = 1.0001 * beyond[lane] - longest * longest
    return wp.max(beyond) > 0.0


@wp.func
def correct_lanes(
    bodies: BodyTable,
    correction: CorrectionTable,
    lanes: LaneState,
    points: wp.array[Lanes3],
    group: wp.int32,
    step_seconds: float,
):
    """All sweeps over all springs, which stand in the order of their colors."""
    for _sweep in range(correction.sweeps):
        for spring in range(correction.particles.shape[0]):
            ends = correction.particles[spring]
            rest_length = correction.rest_lengths[spring]
            limits = lanes.balloons[group, bodies.balloon[ends[0]], CORRECTION_LIMIT]
            d = points[ends[1]] - points[ends[0]]
            if may_be_too_long(d, rest_length, limits):
                moves_p = Lanes3()
                moves_q = Lanes3()
                for lane in range(LANE_COUNT):
                    too_long = excess(column(d, lane), rest_length, limits[lane])
                    move_p, move_q = moves_of_ends(bodies, ends, too_long)
                    moves_p = set_column(moves_p, lane, move_p)
                    moves_q = set_column(moves_q, lane, move_q)
                points[ends[0]] = points[ends[0]] + moves_p
                points[ends[1]] = points[ends[1]] + moves_q
                lanes.velocities[group, ends[0]] = lanes.velocities[group, ends[0]] + moves_p / step_seconds
                lanes.velocities[group, ends[1]] = lanes.velocities[group, ends[1]] + moves_q / step_seconds
