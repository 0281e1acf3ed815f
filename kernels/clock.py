"""The frame counter, on the device so that a captured frame can be replayed."""

import warp as wp


@wp.kernel(enable_backward=False)
def count_frame(frame: wp.array[wp.int32]):
    """One thread."""
    frame[0] = frame[0] + 1
