"""Gradients against differences of a run in double precision, and their conserved quantities."""

from typing import Any

import numpy as np
import pytest
import trimesh
import warp as wp
from gradient_scenes import CASES, N, far, require_way, scene, told_loss, told_of, value_at, ways_of
from reference_runs import run

import balloon_warp as bw
from balloon_warp.trajectories import Trajectories

DOT = 1e-5
"""Of a sum over all places and velocities, whose rounding in float32 is a few 1e-7 each"""


BY_DEFAULT = ("pressure", "launched"), ("gas", "launched"), ("gas on the ground", "launched")
"""cases that run without `--full`, and their ways back"""


@pytest.fixture(params=["block", "launched", "lanes"])
def way(request: pytest.FixtureRequest) -> str:
    """Return the schedule of the backward pass."""
    return request.param


@pytest.mark.parametrize(
    ("case", "way"),
    [
        pytest.param(case, way, marks=() if (case, way) in BY_DEFAULT else pytest.mark.full)
        for case in CASES
        for way in ways_of(case)
    ],
)
def test_gradients_are_the_slopes_of_a_run_in_double_precision(case: str, way: str, device: str):
    """Gradients agree to 2e-4: states are float32, and forces cancel. Springs at rest have none in a single substep."""
    require_way(way, device)
    of, paths = CASES[case]
    found = bw.gradient(of, of=paths, loss=far, device=device, schedule=way)
    assert found.loss[0] == pytest.approx(told_loss(case), rel=1e-5)
    told = told_of(case)
    for path in paths:
        assert found.gradients[path][0] == pytest.approx(told[path], rel=2e-4, abs=1e-6), path
    ahead = np.random.default_rng(5).normal(size=len(paths)) * [max(abs(value_at(of, path)), 1.0) for path in paths]
    along = np.array([found.gradients[path][0] for path in paths]) * ahead
    told_along = np.array([told[path] for path in paths]) * ahead  # parts that cancel each other in the sum
    assert along.sum() == pytest.approx(told_along.sum(), abs=1e-4 * np.linalg.norm(told_along))


def ends_at(of: bw.Scene, weights: Any, shifts: Any) -> float:
    moved = run(of, {}, shifts)
    return float((weights[0] * moved.points[0][-1]).sum() + (weights[1] * moved.velocities[0][-1]).sum())


SHIFTED = {case: CASES[case][0] for case in ("pressure", "gas", "torsion", "wind", "gas on the ground")}
SHIFTED["pump, leak and jet"] = bw.load_scene(CASES["pump, leak and jet"][0], {"balloon.neck.diameter": 0.3})
"""Scenes by whose start is derived: none in which a particle has two nearest faces, as with normal
forces. The jet is strong beside the springs"""


@pytest.mark.full
@pytest.mark.parametrize(("case", "way"), [(case, way) for case in SHIFTED for way in ways_of(case)])
def test_what_a_shift_of_the_start_does_to_the_end_is_what_the_end_says_of_the_start(case: str, way: str, device: str):
    """The adjoint identity u . (J w) = (u J) . w holds for all places and velocities, with J w by differences."""
    require_way(way, device)
    of, rng = SHIFTED[case], np.random.default_rng(11)
    weights, shifts = ([rng.normal(size=(N, 3)), scale * rng.normal(size=(N, 3))] for scale in (0.05, 1.0))

    def loss(moved: Trajectories) -> tuple[Any, dict[str, Any]]:
        slopes = [np.zeros(each[0].shape) for each in (moved.points, moved.velocities)]
        ends = moved.points[0][-1], moved.velocities[0][-1]
        for slope, weight in zip(slopes, weights, strict=True):
            slope[-1] = weight
        value = sum((weight * end).sum() for weight, end in zip(weights, ends, strict=True))
        return value, {"points": slopes[:1], "velocities": slopes[1:]}

    found = bw.gradient(of, of=["balloon.mass"], loss=loss, device=device, schedule=way)
    back = (found.by_points[0] * shifts[0]).sum() + (found.by_velocities[0] * shifts[1]).sum()
    h = 1e-6
    more, less = (ends_at(of, weights, [sign * h * each for each in shifts]) for sign in (1.0, -1.0))
    assert back == pytest.approx((more - less) / (2.0 * h), rel=DOT)


def center(moved: Trajectories) -> tuple[Any, dict[str, Any]]:
    """Return the loss of a ball's final place along x."""
    slopes = np.zeros(moved.points[0].shape)
    slopes[..., -1, :, 0] = 1.0 / N
    return moved.points[0][..., -1, :, 0].mean(axis=-1), {"points": [slopes]}


@pytest.mark.full
def test_the_center_of_what_flies_goes_on_as_it_began():
    """Internal forces do not move the center of a free balloon: only damping slows it."""
    of = ["balloon.velocity.0", "balloon.position.0"]
    found = bw.gradient(CASES["frames"][0], of=of, loss=center, device="cpu").gradients
    step, kept = 1.0 / 60.0 / 32.0, 1.0 - 0.05 / 0.05 / 60.0 / 32.0
    way = step * sum(kept**number for number in range(1, 4 * 32 + 1))
    assert found["balloon.velocity.0"][0] == pytest.approx(way, rel=1e-5)
    assert found["balloon.position.0"][0] == pytest.approx(1.0, rel=1e-5)


IN_BATCHES = (
    "ground",
    "gas on the ground",
    "wind",
    "gas among obstacles",
    "pump, leak and jet",
    "water",
    "gas beside spheres",
    "ridges",
)


@pytest.mark.full
@pytest.mark.parametrize(
    ("case", "way"),
    [(case, way) for case in IN_BATCHES for way in ways_of(case)],
)
def test_a_world_in_a_batch_has_the_gradients_that_it_has_alone(case: str, way: str, device: str):
    require_way(way, device)
    together, paths = CASES[case]
    slower = value_at(together, "balloon.velocity.1") * np.array([1.0, 0.5])
    varied = {"balloon.mass": value_at(together, "balloon.mass") * np.array([1.0, 1.2]), "balloon.velocity.1": slower}
    found = bw.gradient(together, of=paths, loss=far, world_count=2, vary=varied, device=device, schedule=way)
    for world in range(2):
        alone = {path: values[world : world + 1] for path, values in varied.items()}
        single = bw.gradient(together, of=paths, loss=far, vary=alone, device=device, schedule=way)
        assert single.loss[0] == found.loss[world]
        for path in paths:
            assert single.gradients[path][0] == found.gradients[path][world], path
    assert found.loss[0] != found.loss[1]


def test_frames_are_those_without_gradients(way: str, device: str):
    require_way(way, device)
    of, paths = CASES["gas on the ground"]
    found = bw.gradient(of, of=paths, loss=far, device=device, schedule=way).trajectories
    schedule = "gather" if way == "launched" else "octets" if device == "cpu" else "block"
    told = bw.simulate(of, device=device, schedule=schedule)
    for name in ("points", "velocities"):
        np.testing.assert_array_equal(getattr(found, name)[0], getattr(told, name)[0])
    np.testing.assert_array_equal(found.pressures, told.pressures)


@wp.func
def blow(velocity: wp.vec3, mass_share: float, blowing: float):
    """Return the force of a user's law: against the square of the speed."""
    return (-blowing * mass_share * wp.length(velocity)) * velocity


OWN = bw.Law("particle", blow, (bw.Parameter("blowing", "N s^2/m^2", default=0.2),))


def float32_slope(of: bw.Scene, path: str, value: float, laws: tuple = ()) -> float:
    """Return the difference of two float32 runs, of each coordinate by itself."""
    h = 0.02 * value
    moved = bw.simulate(
        of, world_count=3, vary={path: [value - h, value, value + h]}, device="cpu", schedule="gather", laws=laws
    )
    slopes = far(moved)[1]
    total = 0.0
    for name in ("points", "velocities"):
        track = getattr(moved, name)[0].astype(float)
        total += ((track[2] - track[0]) * slopes[name][0][1]).sum()
    total += ((moved.volumes[2] - moved.volumes[0]) * slopes["volumes"][1]).sum()
    return float(total / (2.0 * h))


@pytest.mark.full
def test_laws_that_the_run_in_double_precision_does_not_know():
    """Gradients by viscosity, drag, strings and a user's law agree to 1%, the rounding error of float32 differences.

    A mesh moves and turns below the balloon."""
    below = {"mesh": trimesh.creation.box((2.0, 0.5, 2.0)), "position": (0.0, -0.335, 0.0), "friction": 0.2}
    below["motion"] = [(0.0, (0.0, 0.0, 0.0)), (1.0, (0.0, 0.5, 1.0), (20.0, 0.0, 0.0))]
    springs = {"structural": 100.0, "viscosity": 0.003}
    free = scene(frames=2, drag_coefficient=0.5, stiffness=springs, obstacle=[below], faces=False)
    of = free.model_copy(update={"string": [bw.String(anchor=(0.0, 3.0, 0.0), length=1.0, stiffness=30.0)]})
    values = {"balloon.stiffness.viscosity": 0.003, "balloon.drag_coefficient": 0.5, "balloon.law.blow.blowing": 0.2}
    values["balloon.velocity.1"] = -1.0  # up and down on the string
    found = bw.gradient(of, of=list(values), loss=far, device="cpu", laws=(OWN,)).gradients
    for path, value in values.items():
        assert found[path][0] == pytest.approx(float32_slope(of, path, value, (OWN,)), rel=0.01), path
