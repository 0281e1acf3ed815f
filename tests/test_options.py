"""Options of Warp's compiler, and sizes of arguments that kernels take by value: our kernels leave out how structs are
derived, and those of others do not."""

import ctypes
import re

import numpy as np
import pytest
import warp as wp
from warp._src import codegen

from balloon_warp.kernels import NO_DERIVATIVES, OPTIONS
from balloon_warp.kernels.tables import Tables, WorldState
from balloon_warp.kernels.working import Working


@wp.struct
class Pair:
    """Two numbers, whose derivatives add up."""

    first: float
    second: float


@wp.kernel(module="unique", module_options={"optimization_level": 0})
def multiply(pairs: wp.array(dtype=Pair), products: wp.array[float]):
    pair = pairs[wp.tid() // 2]
    products[wp.tid()] = pair.first * pair.second


def test_how_structs_are_derived_is_left_out_of_our_kernels():
    """Nothing but the code between our macro's lines is derived: it was a third of a small kernel's time."""
    flag = f"-D{NO_DERIVATIVES}="
    assert flag in OPTIONS["cpu_compiler_flags"].split()
    written = codegen.codegen_struct(Pair)
    left_out = re.compile(rf"#ifndef {NO_DERIVATIVES}\n(.*?)#endif\n", re.DOTALL)
    assert len(left_out.findall(written)) == 2
    assert "adj_" in written
    assert "adj_" not in left_out.sub("", written)


def test_sums_of_structs_are_compiled_on_demand():
    """Sums of structs are inline in kernels of others, too, as their modules have our tables' structs."""
    declared = [line for line in codegen.codegen_struct(Pair).splitlines() if " add(" in line or " adj_atomic" in line]
    declared = [line for line in declared if "CUDA_CALLABLE" in line]
    assert [line.split()[0] for line in declared] == ["inline", "inline"]


def test_a_kernel_that_asks_for_them_adds_derivatives_of_threads_that_read_the_same():
    numbers = np.array([(2.0, 3.0), (5.0, 7.0)], dtype=Pair.numpy_dtype())
    pairs = wp.array(numbers, dtype=Pair, device="cpu", requires_grad=True)
    products = wp.zeros(4, dtype=float, device="cpu", requires_grad=True)
    with wp.Tape() as tape:
        wp.launch(multiply, 4, [pairs], [products], device="cpu")
    tape.backward(grads={products: wp.ones_like(products)})
    assert pairs.grad is not None
    np.testing.assert_array_equal(products.numpy(), [6.0, 6.0, 35.0, 35.0])
    assert [tuple(each) for each in pairs.grad.numpy().tolist()] == [(6.0, 4.0), (14.0, 10.0)]


MOST_BYTES = 8192
"""Size up to which a GPU's compiler sees through an argument: with tables of 8,184 bytes kernels for sm_90 had no
stack, with 8,200 those that were looked at had one of 23,000 bytes and more"""


@pytest.mark.parametrize("struct", [Tables, WorldState, Working], ids=lambda struct: struct.key)
def test_a_kernel_takes_no_more_than_its_compiler_sees_through(struct):
    assert ctypes.sizeof(struct.ctype) <= MOST_BYTES
