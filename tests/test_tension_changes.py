"""Changes of the tensions of eight triangles: in each lane what Warp derives of the tensions of one."""

from functools import cache
from typing import Any

import numpy as np
import pytest
import warp as wp
from meshes import quad_sphere
from numpy.typing import NDArray

from balloon_warp.kernels.adjoints.tensions import few_lanes, few_places, tension_changes
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.helpers_of_grad import derive_helpers
from balloon_warp.kernels.lanes import Lanes, Lanes3, Lanes4
from balloon_warp.kernels.loops.membranes import tension_function
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.model import build_model
from balloon_warp.scene import Balloon, Scene
from balloon_warp.schedules.features import model_features

LAWS: dict[str, dict[str, Any]] = {
    "neo_hookean": {},
    "mooney_rivlin": {"mooney_ratio": 0.2},
    "gent": {"gent_limit": 30.0},
    "ogden": {"ogden_moduli": (6e5, 2e3, -1e4), "ogden_exponents": (1.3, 5.0, -2.0)},
}
STRETCHES = {
    "taut": (1.05, 1.9, 1.0),
    "surely taut": (1.3, 1.9, 1.0),
    "in wrinkles": (0.3, 0.6, 1.0),
    "slack": (0.4, 0.9, 1.0),
    "pressed, without wrinkles": (0.4, 0.9, 0.0),
}
"""Range of stretches both ways, and whether it wrinkles; in wrinkles one way is stretched by 1.2 to 2 instead"""


@cache
def features_of(law: str) -> Features:
    return model_features(
        build_model(Scene(balloon=[Balloon(mesh=quad_sphere(1), material={"kind": law, **LAWS[law]})]), "cpu")
    )


@cache
def kernels_of(features: Features) -> tuple[Any, Any]:
    """Return a kernel of eight triangles, and one of each alone, which Warp derives."""
    changes, FewLanes = tension_changes(features), few_lanes(len(few_places(features)))  # noqa: N806 - a type
    tension, width = tension_function(features), features.columns.width
    Row = wp.types.vector(length=width, dtype=wp.float32)  # noqa: N806 - a type

    @wp.func
    def work(metric: wp.vec3, rest: wp.vec4, n: Row, asked: wp.vec3):
        return wp.dot(tension(metric, wp.vec3(), rest, 0, n, 0), asked)

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def of_eight(
        metric: Lanes3, change: Lanes3, rest: Lanes4, n: wp.array[Lanes], found: wp.array2d[Lanes],
        by_numbers: wp.array[FewLanes],
    ):  # fmt: skip
        tensions, by_few = changes(metric, change, rest, 0, n)
        for row in range(6):
            found[0, row] = tensions[row]
        by_numbers[0] = by_few

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def of_one(
        metric: wp.array[wp.vec3], change: wp.array[wp.vec3], rest: wp.array[wp.vec4], n: Row,
        found: wp.array2d[float], by_numbers: wp.array[Row],
    ):  # fmt: skip
        lane = wp.tid()
        c = change[lane]
        # tensions are 2 dE/dM11, dE/dM12 and 2 dE/dM22 of an energy, whose second derivatives are symmetric
        by_metric, _rest, by_n, tensions = wp.grad(work)(  # pyright: ignore[reportGeneralTypeIssues] - a tuple
            metric[lane], rest[lane], n, 0.5 * wp.vec3(c[0], 2.0 * c[1], c[2])
        )
        found[0, lane] = tensions[0]
        found[1, lane] = tensions[1]
        found[2, lane] = tensions[2]
        found[3, lane] = 2.0 * by_metric[0]
        found[4, lane] = by_metric[1]
        found[5, lane] = 2.0 * by_metric[2]
        by_numbers[lane] = by_n

    return of_eight, of_one


def triangles(stretches: tuple[float, float], wrinkled: bool, draw: np.random.Generator) -> tuple[NDArray, ...]:
    """Return metrics, their changes and rest metrics of eight triangles."""
    rests, metrics = [], []
    for _ in range(8):
        edges = np.array([[1.0, 0.0], draw.uniform([-0.4, 0.5], [0.6, 1.2])]) * 0.03
        turn, way = np.linalg.qr(draw.normal(size=(2, 2)))[0], draw.uniform(*stretches, 2)
        if wrinkled:
            way[0] = draw.uniform(1.2, 2.0)
        moved = edges @ turn @ np.diag(way)
        inverse = np.linalg.inv(edges @ edges.T)
        rests.append([inverse[0, 0], inverse[0, 1], inverse[1, 1], draw.uniform(1e-4, 2e-4)])
        product = moved @ moved.T
        metrics.append([product[0, 0], product[0, 1], product[1, 1]])
    return np.array(metrics), 1e-3 * draw.normal(size=(8, 3)), np.array(rests)


@pytest.mark.full
@pytest.mark.parametrize("state", STRETCHES)
@pytest.mark.parametrize("law", LAWS)
def test_they_are_what_warp_derives_of_one(law: str, state: str):
    """Tensions, their changes and the energy's by numbers agree to 2e-4 of the largest of eight, up to what cancels."""
    derive_helpers()
    least, most, wrinkling = STRETCHES[state]
    features, draw = features_of(law), np.random.default_rng(7)
    of_eight, of_one = kernels_of(features)
    metric, change, rest = triangles((least, most), state == "in wrinkles", draw)
    numbers = np.zeros(features.columns.width, dtype=np.float32)
    values = {"shear_modulus": 3e5, "thickness": 2e-4, "wrinkling": wrinkling, "most_stretch": 5.0, **LAWS[law]}
    for name, value in values.items():
        if name in features.columns.places:
            place, size = features.columns.places[name], features.columns.sizes[name]
            numbers[place : place + size] = value
    few = few_places(features)
    found, by_numbers = (
        wp.zeros((1, 6), dtype=Lanes, device="cpu"),
        wp.zeros(1, dtype=few_lanes(len(few)), device="cpu"),
    )
    rows = wp.array(np.repeat(numbers[:, None], 8, axis=1), dtype=Lanes, device="cpu")
    as_lanes = [kind(*each.T.ravel().tolist()) for kind, each in ((Lanes3, metric), (Lanes3, change), (Lanes4, rest))]
    wp.launch(of_eight, 1, inputs=[*as_lanes, rows], outputs=[found, by_numbers], device="cpu")
    Row = wp.types.vector(length=len(numbers), dtype=wp.float32)  # noqa: N806 - a type
    told, told_by_numbers = wp.zeros((6, 8), dtype=float, device="cpu"), wp.zeros(8, dtype=Row, device="cpu")
    alone = [
        wp.array(each, dtype=kind, device="cpu")
        for kind, each in ((wp.vec3, metric), (wp.vec3, change), (wp.vec4, rest))
    ]
    wp.launch(of_one, 8, inputs=[*alone, Row(*numbers.tolist())], outputs=[told, told_by_numbers], device="cpu")
    tensions, expected = found.numpy()[0], told.numpy()
    if state == "slack":
        assert not tensions.any()
        assert not by_numbers.numpy().any()
        return
    for rows_of in (slice(0, 3), slice(3, 6)):
        largest = np.abs(expected[rows_of]).max()
        assert largest > 0.0
        np.testing.assert_allclose(tensions[rows_of], expected[rows_of], rtol=0, atol=2e-4 * largest)
    for one, other, column in zip(by_numbers.numpy()[0], told_by_numbers.numpy()[:, list(few)].T, few, strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=2e-4 * np.abs(other).max(), err_msg=str(column))
