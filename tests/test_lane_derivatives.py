"""Derivatives of what has eight numbers or vectors side by side: in each lane those of one alone."""
# pyright: reportRedeclaration=false

from typing import Any

import numpy as np
import pytest
import warp as wp

from balloon_warp.kernels import algebra
from balloon_warp.kernels.codegen import function_from, kernel_from
from balloon_warp.kernels.helpers_of_grad import derive_helpers
from balloon_warp.kernels.lanes import IN_LANES, Lanes, Lanes2, Lanes3, Lanes5, five, of_lane, pair, set_lane
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.phases.move import kick, response

UP = wp.constant(wp.vec3(0.2, -0.5, 0.8))
TYPES: dict[str, Any] = {"number": float, "vector": wp.vec3}


@wp.func
def reach_up(vector: Any):
    return algebra.reach_along(vector, UP)


@wp.func
def respond(mass: Any):
    return response(mass, 0.01)


@wp.func
def pair_of_one(number: Any):
    return pair(number, 0.0)


@wp.func
def five_of(a: Any, b: Any):
    return five(a, b, algebra.times(a, b), b, a)


@wp.func
def larger(a: float, b: float):
    return wp.max(a, b)


@wp.func
def larger(a: Lanes, b: Lanes):  # noqa: F811 - an overload
    return algebra.larger(a, b)


@wp.func
def plus_scaled(total: wp.vec3, vector: wp.vec3, factor: float):
    return total + factor * vector


@wp.func
def plus_scaled(total: Lanes3, vector: Lanes3, factor: Lanes):  # noqa: F811 - an overload
    return algebra.plus_scaled(total, vector, factor)


@wp.func
def worth(value: Any, weight: Any):
    """Return a value times its weight."""
    return wp.dot(value, weight)


@wp.func
def worth(value: float, weight: float):  # noqa: F811 - an overload
    return value * weight


@wp.func
def worth(value: Lanes3, weight: Lanes3):  # noqa: F811 - an overload
    return wp.ddot(value, weight)


@wp.func
def worth(value: Lanes2, weight: Lanes2):  # noqa: F811 - an overload
    return wp.ddot(value, weight)


@wp.func
def worth(value: Lanes5, weight: Lanes5):  # noqa: F811 - an overload
    return wp.ddot(value, weight)


CASES: dict[str, tuple[Any, tuple[str, ...]]] = {
    "times": (algebra.times, ("number", "number")),
    "cross_product": (algebra.cross_product, ("vector", "vector")),
    "dot_product": (algebra.dot_product, ("vector", "vector")),
    "reach_along": (reach_up, ("vector",)),
    "scaled": (algebra.scaled, ("vector", "number")),
    "plus_scaled": (plus_scaled, ("vector", "vector", "number")),
    "length_of": (algebra.length_of, ("vector",)),
    "squared_length": (algebra.squared_length, ("vector",)),
    "larger": (larger, ("number", "number")),
    "response": (respond, ("number",)),
    "kick": (kick, ("vector", "vector", "number")),
    "pair": (pair_of_one, ("number",)),
    "five": (five_of, ("number", "number")),
}
"""Functions of one item and of eight, and what they take"""


def derivatives(function: Any, kinds: tuple[str, ...], given: list[np.ndarray]) -> list[list[np.ndarray]]:
    """Return the derivatives of half the square of a function's result: of eight at once, and one by one."""
    names = [f"x{place}" for place in range(len(kinds))]
    types = [IN_LANES[TYPES[kind]] for kind in kinds]
    work = f"def work({', '.join(f'{name}: Any' for name in names)}):\n"
    work += f"    value = f({', '.join(names)})\n    return 0.5 * worth(value, value)\n"
    arrays = [*names, *(f"{way}_{name}" for way in ("all", "each") for name in names)]
    lines = [f"def derive({', '.join(f'{name}: wp.array[{name[-2:]}_lanes]' for name in arrays)}):"]
    lines += [f"    {', '.join(f'by_{name}' for name in names)} = wp.grad(work)({', '.join(f'{n}[0]' for n in names)})"]
    lines += [f"    all_{name}[0] = by_{name}" for name in names]
    lines += ["    for lane in range(8):"]
    ones = ", ".join(f"of_lane({name}[0], lane)" for name in names)
    lines += [f"        {', '.join(f'one_{name}' for name in names)} = wp.grad(work)({ones})"]
    lines += [f"        each_{name}[0] = set_lane(each_{name}[0], lane, one_{name})" for name in names]
    space = {"f": function, "worth": worth, "of_lane": of_lane, "set_lane": set_lane}
    space |= {f"{name}_lanes": dtype for name, dtype in zip(names, types, strict=True)}
    space["work"] = function_from("work", work, space)
    kernel = kernel_from("derive", "\n".join([*lines, ""]), space, module_options=OPTIONS)
    inputs = [wp.array(each[None], dtype=dtype, device="cpu") for each, dtype in zip(given, types, strict=True)]
    found = [[wp.zeros(1, dtype=dtype, device="cpu") for dtype in types] for _ in range(2)]
    wp.launch(kernel, 1, [*inputs, *found[0], *found[1]], device="cpu")
    return [[each.numpy()[0] for each in some] for some in found]


@pytest.mark.full
@pytest.mark.parametrize("case", CASES)
def test_eight_side_by_side_have_the_derivatives_of_each(case: str):
    """Derivatives agree to rounding: products add up in another order."""
    derive_helpers()
    function, kinds = CASES[case]
    draw = np.random.default_rng(2)
    given = [draw.uniform(0.5, 2.0, (8,) if kind == "number" else (3, 8)).astype(np.float32) for kind in kinds]
    at_once, one_by_one = derivatives(function, kinds, given)
    for all_lanes, each in zip(at_once, one_by_one, strict=True):
        assert each.any()
        np.testing.assert_allclose(all_lanes, each, rtol=1e-5, atol=1e-6)
