"""Lists of particles that are noted have all of them, once each."""

import numpy as np
import pytest
import warp as wp

from balloon_warp.kernels.schedules.notes import eight_bytes_in, list_marked
from balloon_warp.kernels.schedules.warps import block_barrier, count_at, put_count, shared_words

MOST = 256
THREADS = 32
words = shared_words("noted", 1 + MOST)


@wp.kernel(enable_backward=False)
def list_noted(notes: wp.array2d[wp.int8], first: wp.int32, out: wp.array[wp.int32]):
    """A block: the length of the list, and what is in it."""
    thread = wp.tid()
    if thread == 0:
        put_count(words(), 0, 0)
    block_barrier()
    for eight in range(8 * thread, MOST, 8 * wp.block_dim()):
        list_marked(words(), eight_bytes_in(notes, first + eight), first + eight)
    block_barrier()
    for place in range(thread, 1 + count_at(words(), 0), wp.block_dim()):
        out[place] = count_at(words(), place)


@pytest.mark.parametrize("part", [0.0, 0.1, 1.0])
def test_all_that_are_noted_are_listed(part, device):
    """Of five worlds of 61 particles, which no eight ends with; the second list ends where they do."""
    noted = (np.random.default_rng(1).random((5, 61)) < part) * np.int8(-3)
    notes, found = wp.array(noted, dtype=wp.int8, device=device), []
    for first in (0, MOST):
        out = wp.zeros(1 + MOST, dtype=wp.int32, device=device)
        threads = THREADS if wp.get_device(device).is_cuda else 1
        wp.launch(list_noted, dim=threads, inputs=[notes, first, out], block_dim=threads, device=device)
        listed = out.numpy()
        found += sorted(listed[1 : 1 + listed[0]])
    np.testing.assert_array_equal(found, np.flatnonzero(noted))
