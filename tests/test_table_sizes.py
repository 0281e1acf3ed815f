"""Sizes of what kernels take by value."""

import ctypes

import pytest

from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.working import Working

MOST_BYTES = 8192
"""Size up to which a GPU's compiler keeps an argument in registers and constants: of 8,184 bytes kernels had no stack,
of 8,200 they all had one of some 23,000 bytes, and up to 27,000 bytes of loads from it"""


@pytest.mark.parametrize("struct", [Tables, WorldState, Working], ids=lambda struct: struct.key)
def test_a_kernel_takes_no_more_than_its_compiler_sees_through(struct):
    assert ctypes.sizeof(struct.ctype) <= MOST_BYTES
