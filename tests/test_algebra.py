"""Algebra of one vector and of eight in lanes: values against NumPy, derivatives against each other."""

from typing import Any

import numpy as np
import pytest
import warp as wp
from numpy.typing import NDArray

from balloon_warp.kernels.algebra import (
    cross_product,
    dot_product,
    inverse_root,
    larger,
    length_of,
    plus_scaled,
    reach_along,
    scaled,
    squared_length,
    times,
)
from balloon_warp.kernels.lanes import LANE_COUNT, Lanes, Lanes3, Lanes5

MODULE: dict[str, Any] = {"module": "unique", "module_options": {"enable_backward": True}}


@wp.kernel(**MODULE)
def in_lanes(
    vectors: wp.array[Lanes3],
    numbers: wp.array[Lanes],
    fives: wp.array[Lanes5],
    factor: wp.array[float],
    way: wp.array[wp.vec3],
    of_vectors: wp.array[Lanes3],
    of_numbers: wp.array[Lanes],
    of_fives: wp.array[Lanes5],
):
    a = vectors[0]
    b = vectors[1]
    f = numbers[0]
    g = numbers[1]
    of_vectors[0] = cross_product(a, b)
    of_vectors[1] = scaled(a, f)
    of_vectors[2] = scaled(a, factor[0])
    of_vectors[3] = plus_scaled(a, b, f)
    of_numbers[0] = dot_product(a, b)
    of_numbers[1] = reach_along(a, way[0])
    of_numbers[2] = times(f, g)
    of_numbers[3] = times(factor[0], f)
    of_numbers[4] = scaled(f, g)
    of_numbers[5] = larger(f, g)
    of_numbers[6] = squared_length(a)
    of_numbers[7] = length_of(a)
    of_fives[0] = scaled(fives[0], f)


@wp.kernel(**MODULE)
def one_by_one(
    vectors: wp.array2d[wp.vec3],
    numbers: wp.array2d[float],
    fives: wp.array3d[float],
    factor: wp.array[float],
    way: wp.array[wp.vec3],
    of_vectors: wp.array2d[wp.vec3],
    of_numbers: wp.array2d[float],
    of_fives: wp.array3d[float],
):
    lane = wp.tid()
    a = vectors[0, lane]
    b = vectors[1, lane]
    f = numbers[0, lane]
    g = numbers[1, lane]
    of_vectors[0, lane] = cross_product(a, b)
    of_vectors[1, lane] = scaled(a, f)
    of_vectors[2, lane] = scaled(a, factor[0])
    of_vectors[3, lane] = a + scaled(b, f)
    of_numbers[0, lane] = dot_product(a, b)
    of_numbers[1, lane] = reach_along(a, way[0])
    of_numbers[2, lane] = times(f, g)
    of_numbers[3, lane] = times(factor[0], f)
    of_numbers[4, lane] = f * g
    of_numbers[5, lane] = wp.max(f, g)
    of_numbers[6, lane] = squared_length(a)
    of_numbers[7, lane] = (
        length_of(a) * squared_length(a) * inverse_root(squared_length(a)) * inverse_root(wp.dot(a, a))
    )
    for row in range(5):
        of_fives[0, row, lane] = fives[0, row, lane] * f


RNG = np.random.default_rng(2)
VECTORS, NUMBERS, FIVES, FACTOR, WAY = (
    RNG.uniform(-2.0, 2.0, shape).astype(np.float32)
    for shape in ((2, LANE_COUNT, 3), (2, LANE_COUNT), (1, 5, LANE_COUNT), (1,), (1, 3))
)
(A, B), (F, G) = VECTORS.astype(float), NUMBERS.astype(float)
EXPECTED = (
    np.stack([np.cross(A, B), F[:, None] * A, float(FACTOR[0]) * A, A + F[:, None] * B]),
    np.stack([(A * B).sum(axis=1), A @ WAY[0], F * G, FACTOR[0] * F, F * G, np.maximum(F, G),
              (A**2).sum(axis=1), np.linalg.norm(A, axis=1)]),
    FIVES * F,
)  # fmt: skip


def launched(lanes: bool) -> tuple[list[NDArray[Any]], list[NDArray[Any]]]:
    """Return the results, and the derivatives of a weighted sum of vectors and numbers by all inputs but the fives, by
    which none is taken."""

    def array(values: NDArray[Any], dtype: Any) -> wp.array:
        return wp.array(values, dtype=dtype, device="cpu", requires_grad=True)

    def turned(vectors: NDArray[Any], *others: NDArray[Any]) -> list[NDArray[Any]]:
        return [np.swapaxes(vectors, 1, 2) if lanes else vectors, *others]

    kinds = [Lanes3, Lanes, Lanes5, float, wp.vec3] if lanes else [wp.vec3, float, float, float, wp.vec3]
    inputs = list(map(array, turned(VECTORS, NUMBERS, FIVES, FACTOR, WAY), kinds))
    out = [array(np.zeros_like(each), kind) for each, kind in zip(turned(*EXPECTED), kinds, strict=False)]
    with wp.Tape() as tape:
        wp.launch(in_lanes if lanes else one_by_one, 1 if lanes else LANE_COUNT, [*inputs, *out], device="cpu")
    rng = np.random.default_rng(3)
    weights = turned(*(rng.uniform(-1.0, 1.0, each.shape) for each in EXPECTED[:2]))
    tape.backward(grads={out[i]: wp.array(weights[i], dtype=kinds[i], device="cpu") for i in range(2)})
    slopes = [tape.gradients[inputs[i]].numpy() for i in (0, 1, 3, 4)]
    return turned(*(each.numpy() for each in out)), turned(*slopes)


@pytest.mark.parametrize("lanes", [False, True], ids=["one", "eight"])
def test_functions_are_those_of_numpy(lanes: bool):
    """The tolerance is some roundings of numbers of up to 12."""
    for found, expected in zip(launched(lanes)[0], EXPECTED, strict=True):
        np.testing.assert_allclose(found, expected, atol=2e-6)


def test_derivatives_of_eight_are_those_of_each():
    for found, expected in zip(launched(True)[1], launched(False)[1], strict=True):
        assert np.abs(expected).min() > 0.0
        np.testing.assert_allclose(found, expected, atol=1e-5)
