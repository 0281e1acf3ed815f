"""Times of a substep, and keyframed values then."""

import warp as wp

from balloon_warp.kernels.memory import two_in
from balloon_warp.kernels.tables import Tables, WorldState


@wp.func
def time_of(t: Tables, frame: wp.array[wp.int32], time_in_frame: float):
    """Return the time since the simulation began [s]."""
    return float(frame[0]) * t.frame_seconds + time_in_frame


@wp.func
def ramp_at(state: WorldState, world: wp.int32, balloon: wp.int32, time_in_frame: float):
    """Return a keyframed value, such as k_normal, at a time in the frame."""
    ramp = two_in(state.inflation_ramp, world, balloon)
    return ramp[0] + ramp[1] * time_in_frame
