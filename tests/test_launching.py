"""Compilation of kernels in background threads, whose errors reach the launching thread."""

from typing import Any

import pytest
import warp as wp

from balloon_warp import launching
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.launching import begin_loading, launch

wp.set_module_options({**OPTIONS, "enable_backward": False})


@wp.kernel(module="unique")
def count(counts: wp.array[wp.int32]):
    counts[wp.tid()] = wp.tid()


@wp.kernel(module="unique")
def add_a_vector(counts: wp.array[wp.int32]):
    counts[wp.tid()] = counts[wp.tid()] + wp.vec3(1.0)  # which Warp refuses


def test_a_kernel_begun_ahead_is_launched():
    counts = wp.zeros(3, dtype=wp.int32, device="cpu")
    kernel: Any = count
    begin_loading(kernel, counts.device)
    launching._begun[kernel.module].result(timeout=60.0)
    assert kernel.module.execs  # compiled, and loaded, without a launch
    launch(kernel, 3, [counts], device=counts.device)
    assert counts.numpy().tolist() == [0, 1, 2]


def test_a_kernel_that_does_not_compile_is_told_at_each_launch():
    counts = wp.zeros(3, dtype=wp.int32, device="cpu")
    begin_loading(add_a_vector, counts.device)
    for _ in range(2):
        with pytest.raises(Exception, match="Couldn't find function overload"):
            launch(add_a_vector, 3, [counts], device=counts.device)
