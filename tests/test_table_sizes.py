"""Sizes of what kernels take by value."""

import ctypes

import pytest

from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.working import Working

MOST_BYTES = 8192
"""Size up to which a GPU's compiler sees through an argument: with tables of 8,184 bytes kernels for sm_90 had no
stack, with 8,200 those that were looked at had one of 23,000 bytes and more"""


@pytest.mark.parametrize("struct", [Tables, WorldState, Working], ids=lambda struct: struct.key)
def test_a_kernel_takes_no_more_than_its_compiler_sees_through(struct):
    assert ctypes.sizeof(struct.ctype) <= MOST_BYTES
