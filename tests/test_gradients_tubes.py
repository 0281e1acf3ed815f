"""Gradients of gas that flows through tubes, against differences of a run in double precision."""

from typing import Any

import numpy as np
import pytest
from dot_products import require_adjoint
from gradient_scenes import BALL, scene
from reference_runs import run

import balloon_warp as bw
from balloon_warp.statics.volume import Volume
from balloon_warp.trajectories import Trajectories

OF = [
    *(f"balloon.{number}.inflation.start_pressure" for number in range(2)),
    *("balloon.0.mass", "balloon.1.stiffness.structural", "tube.0.conductance", "atmosphere.pressure"),
]
CONDUCTANCES = (5e-4, 3e-4)
FIRM = {"structural": 1500.0}
"""Springs that keep pressures apart: each is the difference of absolute ones, of which states in float32 leave less"""


def tubed(count: int, width: float = 1.0, leak: float = 0.0) -> bw.Scene:
    """Return two balls with a gas, one at three times the pressure of the other, and tubes between them.

    Args:
        width: factor on conductances.
        leak: of both [m^2].
    """
    low, high = (
        scene(
            "gas",
            gas={"start_pressure": pressure, "leak": leak},
            position=(side, 1.0, 0.0),
            mass=mass,
            springs=FIRM,
        ).balloon[0]
        for pressure, side, mass in ((900.0, -2.0, 0.05), (2700.0, 2.0, 0.1))
    )
    tubes = [bw.Tube(balloons=(0, 1), conductance=width * each) for each in CONDUCTANCES[:count]]
    return scene("gas", frames=2).model_copy(update={"balloon": [low, high], "touch": False, "tube": tubes})


def sizes(moved: Trajectories) -> tuple[Any, dict[str, Any]]:
    """Return a loss of volumes, one more than the other, and of how far balls have spread, with derivatives."""
    weights = np.array([1.0, 2.0])
    slopes, points = np.zeros(moved.volumes.shape), [np.zeros(part.shape) for part in moved.points]
    slopes[..., 1:, :] = weights
    loss = (weights * moved.volumes[..., 1:, :]).sum(axis=(-2, -1))
    for part, found in zip(moved.points, points, strict=True):
        found[..., -1, :, 1] = 0.1
        loss = loss + 0.1 * part[..., -1, :, 1].sum(axis=-1)
    return loss, {"volumes": slopes, "points": points}


def sizes_in_float64(of: bw.Scene, values: dict[str, float]) -> float:
    volume, places = Volume(BALL), run(of, values).points
    return sum(
        (number + 1.0) * sum(volume.of(each) for each in part[1:]) + 0.1 * part[-1, :, 1].sum()
        for number, part in enumerate(places)
    )


def value_at(of: bw.Scene, path: str) -> float:
    value: Any = of
    for name in path.split("."):
        value = value[int(name)] if name.isdecimal() else getattr(value, name)
    return float(value)


@pytest.mark.full
@pytest.mark.parametrize(("count", "width", "leak"), [(1, 1.0, 0.0), (2, 1.0, 0.0), (1, 400.0, 0.0), (2, 1.0, 2e-3)])
def test_gas_through_tubes_has_the_slopes_of_a_run_in_double_precision(
    count: int, width: float, leak: float, device: str
):
    """Gas flows from the second balloon to the first; two tubes depend on each other, and are found in sweeps.

    Through a wide tube pressures meet within a substep: how they fall as gas flows then counts as much as they do.
    Beside leaks flows depend on these, too.
    """
    of = tubed(count, width, leak)
    paths = OF + ["balloon.1.inflation.leak"] * (leak > 0.0)
    found = bw.gradient(of, of=paths, loss=sizes, device=device)
    assert found.loss[0] == pytest.approx(sizes_in_float64(of, {}), rel=1e-5)
    slopes = {}
    for path in paths:
        h = 1e-4 * value_at(of, path)  # all is smooth, and less would drown in rounding
        more, less = (sizes_in_float64(of, {path: value_at(of, path) + side * h}) for side in (1.0, -1.0))
        slopes[path] = (more - less) / (2.0 * h)
    most = max(abs(slopes[path] * value_at(of, path)) for path in paths)
    for path in paths:  # 1e-7 of what the largest says by its own value is rounding of states in float32
        near = pytest.approx(slopes[path], rel=1e-4, abs=1e-7 * most / value_at(of, path))
        assert found.gradients[path][0] == near, path
    told = bw.simulate(of, device=device, schedule="gather")
    np.testing.assert_array_equal(found.trajectories.points[1], told.points[1])


@pytest.mark.full
@pytest.mark.parametrize("count", [1, 2])
def test_what_a_shift_of_the_start_does_to_the_end_is_what_the_end_says_of_the_start(count: int, device: str):
    of = tubed(count)

    def ends(values: dict[str, float], shifts: Any) -> Any:
        return *([part[-1] for part in parts] for parts in run(of, values, shifts)[:2]), {}

    require_adjoint(of, ends, {path: value_at(of, path) for path in OF}, device)
