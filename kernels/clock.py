"""Times of a substep, and keyframed values then; the clock of launches that are replayed for other substeps, too."""

import warp as wp

from balloon_warp.kernels.memory import two_in
from balloon_warp.kernels.tables import Tables, WorldState


@wp.struct
class Clock:
    """Clock of launches: a substep's time in the frame, however often its recording is replayed."""

    done: wp.array[wp.int32]
    """Number of substeps by which the frame is further on than the number that a launch is given says; one entry"""
    left: wp.array[wp.int32]
    """Turns that rounds have yet to make, see `frames.rounds`; two entries, the second of rounds within rounds"""
    substep_seconds: wp.float64


@wp.func
def time_in_frame_of(clock: Clock, substep: wp.int32):
    """Return the time at which a substep begins [s]."""
    return float(wp.float64(clock.done[0] + substep) * clock.substep_seconds)


@wp.func
def time_of(t: Tables, frame: wp.array[wp.int32], time_in_frame: float):
    """Return the time since the simulation began [s]."""
    return float(frame[0]) * t.frame_seconds + time_in_frame


@wp.func
def ramp_at(state: WorldState, world: wp.int32, balloon: wp.int32, time_in_frame: float):
    """Return a keyframed value, such as k_normal, at a time in the frame."""
    ramp = two_in(state.inflation_ramp, world, balloon)
    return ramp[0] + ramp[1] * time_in_frame
