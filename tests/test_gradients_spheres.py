"""Gradients of spheres that fly, press a balloon, and meet each other, obstacles and the ground; and refusals."""

from typing import Any

import numpy as np
import pytest
import trimesh
from dot_products import require_adjoint
from gradient_scenes import CASES, PRESSED, far, scene, value_at
from reference_runs import run

import balloon_warp as bw
from balloon_warp.trajectories import Trajectories

BESIDE, PATHS = CASES["gas beside spheres"]


MEETING: list[dict[str, Any]] = [
    {"position": (-0.5, 2.5, 0.1), "radius": 0.9, "mass": 0.5, "velocity": (0.5, -4.0, 0.0), "penalty": 0.6,
     "friction": 0.2},
    {"position": (3.0, 0.42, 0.0), "radius": 0.4, "mass": 0.3, "velocity": (4.0, -2.0, 1.0), "friction": 0.3,
     "angular_velocity": (2.0, 1.0, 3.0), "restitution": 0.6},
    {"position": (4.0, 0.6, 0.1), "radius": 0.5, "mass": 0.8, "velocity": (-4.0, -1.0, 0.0), "friction": 0.4,
     "restitution": 0.5},
]  # fmt: skip
"""A sphere that falls on a ball, and two that meet each other on the ground"""
BETWEEN: list[dict[str, Any]] = [
    {"size": (1.0, 1.0, 3.0), "rotation": (0.0, 0.0, 20.0), "position": (2.05, 0.2, 0.0), "friction": 0.3,
     "restitution": 0.5},
    {"shape": "plane", "rotation": (0.0, 0.0, 60.0), "position": (4.9, 0.0, 0.0), "friction": 0.2, "thickness": 0.01},
    {"radius": 0.5, "length": 1.0, "rotation": (80.0, 0.0, 0.0), "position": (-1.9, 2.2, 0.1), "friction": 0.4},
]  # fmt: skip
"""A box, a plane and a capsule in their ways"""
PLANE, OUT = BETWEEN[1], np.array([-np.sin(np.pi / 3.0), 0.5, 0.0])
SLAB = {**PLANE, "shape": "mesh", "mesh": trimesh.creation.box((12.0, 4.0, 12.0)),
        "position": tuple(np.array(PLANE["position"]) - 2.0 * OUT)}  # fmt: skip
"""The plane, as the side of a mesh"""
OF_SPHERES = [
    f"sphere.{number}.{name}"
    for number in range(3)
    for name in ("mass", "radius", "position.0", "position.2", "velocity.0", "velocity.2", "angular_velocity.2")
    if (number, name) != (0, "angular_velocity.2")  # which rubs on nothing
]
OF_ALL = ["balloon.0.mass", "balloon.0.velocity.0", "gravity", "ground.height", "ground.restitution", *OF_SPHERES]
OF_RUBBING = [
    *(f"sphere.{number}.{name}" for number in (1, 2) for name in ("friction", "restitution")),
    "obstacle.0.restitution",
]
RNG = np.random.default_rng(3)
WEIGHTS, OF_COURSES = RNG.uniform(0.5, 1.5, (26, 3)), RNG.normal(size=(2, 3, 3))


def meeting(contact: str, obstacle: Any = BETWEEN) -> bw.Scene:
    """Return a scene of 192 substeps in which spheres meet a ball, each other, obstacles and the ground."""
    return scene(ground=True, frames=6, sphere=MEETING, obstacle=obstacle, faces=False, contact=contact)


EXCHANGING: list[dict[str, Any]] = [
    {"position": (0.3, 0.5012, 0.1), "radius": 0.5, "mass": 0.2, "velocity": (0.2, -1.0, 0.1), "friction": 0.4,
     "angular_velocity": (0.0, 0.0, 1.0)},
    {"position": (0.1, 0.89, 1.35), "radius": 0.9, "mass": 0.3, "velocity": (0.0, -0.2, -1.0), "friction": 0.3,
     "angular_velocity": (2.0, 1.0, 3.0)},
]  # fmt: skip
"""Spheres that a ball meets from above: one lands beneath it, and both exchange momentum with the same particles"""


BETWEEN_CORNERS: list[dict[str, Any]] = [
    EXCHANGING[0] | {"radius": 0.82, "position": (0.3, 0.8212, 0.1)},
    EXCHANGING[1] | {"position": (0.15, 1.85, 1.66)},
]  # fmt: skip
"""Spheres that faces meet between their corners, one beneath a ball and one beside it"""


def exchange() -> bw.Scene:
    """Return a scene of a ball with a gas that exchanges momentum with spheres, in 2 frames of 3 substeps: so short
    that nothing rests on the ground, where rounding would decide whether there is a gap."""
    return scene(
        "gas", ground=True, frames=2, rate=640.0, substeps=3, sphere=EXCHANGING, contact="impulse",
        position=(0.0, 1.6, 0.0), velocity=(0.1, -2.0, 0.0),
    )  # fmt: skip


def between_corners() -> bw.Scene:
    """Return the same, with spheres that faces meet, too, as they do edges."""
    return scene(
        "gas", ground=True, frames=2, rate=640.0, substeps=3, sphere=BETWEEN_CORNERS, contact="impulse",
        position=(0.0, 1.75, 0.0), velocity=(0.1, -2.0, 0.0), faces=True,
    )  # fmt: skip


OF_EXCHANGE = [
    *("balloon.0.mass", "balloon.0.velocity.0", "balloon.0.inflation.start_pressure", "gravity", "ground.height"),
    *(f"balloon.0.stiffness.{name}" for name in ("structural", "shear")),
    *(
        f"sphere.{number}.{name}"
        for number in range(2)
        for name in ("mass", "radius", "position.0", "position.2", "velocity.0", "velocity.1", "angular_velocity.2")
    ),
]
CASES_OF_SPHERES = {"exchange": (exchange(), OF_EXCHANGE), "faces": (between_corners(), OF_EXCHANGE)}


def ends(moved: Trajectories) -> tuple[Any, dict[str, Any]]:
    """Return a loss of the last frame, with derivatives: weighted places, and places and velocities of spheres."""
    tracks = {"points": moved.points[0], **{name: getattr(moved, name) for name in SPHERE_TRACKS}}
    slopes, loss = {name: np.zeros(track.shape) for name, track in tracks.items()}, 0.0
    for (name, track), each in zip(tracks.items(), (WEIGHTS, *OF_COURSES), strict=True):
        weights = each[: track.shape[-2]]
        slopes[name][..., -1, :, :] = weights
        loss = loss + (weights * track[..., -1, :, :]).sum(axis=(-2, -1))
    return loss, {**slopes, "points": [slopes["points"]]}


SPHERE_TRACKS = ("sphere_positions", "sphere_velocities")


def ends_in_float64(of: bw.Scene, values: dict[str, float]) -> float:
    told = run(of, values)
    courses = (told.points[0], *(getattr(told, name) for name in SPHERE_TRACKS))
    tracks = zip(courses, (WEIGHTS, *OF_COURSES), strict=True)
    return float(sum((weights[: track.shape[1]] * track[-1]).sum() for track, weights in tracks))


def value_of(of: bw.Scene, path: str) -> float:
    value: Any = of
    for name in path.split("."):
        value = value[int(name)] if name.isdecimal() else getattr(value, name)
    return float(value)


def require_slopes(of: bw.Scene, paths: list[str], found: bw.Gradient, told: bw.Scene) -> None:
    """Check that gradients agree with differences along directions in which each path makes as much of the loss, to
    2e-4 of what one of them does: a small derivative is the difference of larger ones, whose states are float32."""
    assert found.loss[0] == pytest.approx(ends_in_float64(told, {}), rel=1e-5)
    slopes = np.array([found.gradients[path][0] for path in paths])
    for signs in np.random.default_rng(6).choice([-1.0, 1.0], size=(2, len(paths))):
        steps = 1e-7 * signs / slopes
        values = np.array([value_of(of, path) for path in paths])
        more, less = (
            ends_in_float64(told, dict(zip(paths, values + side * steps, strict=True))) for side in (1.0, -1.0)
        )
        assert signs.sum() == pytest.approx((more - less) / 2e-7, abs=2e-4 * np.sqrt(len(paths)))


@pytest.mark.full
def test_spheres_that_push_and_bounce_have_the_slopes_of_a_run_in_double_precision(device: str):
    """Two spheres meet on the ground, a box, a plane that is a mesh's side, and a capsule; one presses the ball."""
    of = meeting(contact="penalty", obstacle=[BETWEEN[0], SLAB, BETWEEN[2]])
    paths = [*OF_ALL, "sphere.0.penalty"]
    require_slopes(of, paths, bw.gradient(of, of=paths, loss=ends, device=device), meeting(contact="penalty"))


@pytest.mark.full
def test_gradients_by_friction_and_restitution_of_spheres(device: str):
    """Two smooth spheres slip where they meet; one bounces off a box. States are float32, hence 1e-4."""
    smooth = [MEETING[0], MEETING[1], {**MEETING[2], "friction": 0.05}]
    spheres = {"sphere": [bw.Sphere(**sphere) for sphere in smooth]}
    beside_slab, of = (
        meeting(contact="penalty", obstacle=[BETWEEN[0], side, BETWEEN[2]]).model_copy(update=spheres)
        for side in (SLAB, PLANE)
    )
    found = bw.gradient(beside_slab, of=OF_RUBBING, loss=ends, device=device).gradients
    steps = {path: 1e-7 / found[path][0] for path in OF_RUBBING}  # of which each makes as much of the loss
    more, less = (
        ends_in_float64(of, {path: value_of(of, path) + side * step for path, step in steps.items()})
        for side in (1.0, -1.0)
    )
    assert (more - less) / 2e-7 == pytest.approx(len(steps), abs=1e-4)


def with_spheres(*changed: dict[str, Any]) -> bw.Scene:
    """Return the scene of the case, whose kernels it shares, with other values of its two spheres."""
    spheres = [bw.Sphere(**{**told, **more}) for told, more in zip(PRESSED, changed, strict=True)]
    return BESIDE.model_copy(update={"sphere": spheres})


def far_and_high(moved: Trajectories) -> tuple[Any, dict[str, Any]]:
    """Return a loss of the ball's final distance and the first sphere's final height and velocity, with derivatives."""
    loss, by_ball = far(moved)
    slopes = {name: np.zeros(getattr(moved, name).shape) for name in ("sphere_positions", "sphere_velocities")}
    for name in slopes:
        slopes[name][-1, 0, 1] = 1.0
    return loss + moved.sphere_positions[-1, 0, 1] + moved.sphere_velocities[-1, 0, 1], by_ball | slopes


@pytest.mark.full
@pytest.mark.parametrize("case", ["penalty", "impulse"])
def test_what_a_shift_of_the_start_does_to_the_end_is_what_the_end_says_of_the_start(case: str, device: str):
    of, paths = (BESIDE, PATHS) if case == "penalty" else (exchange(), OF_EXCHANGE)

    def ends(values: dict[str, float], shifts: Any) -> Any:
        told = run(of, values, shifts)
        courses = {name: getattr(told, name)[-1] for name in SPHERE_TRACKS}
        return [told.points[0][-1]], [told.velocities[0][-1]], courses

    require_adjoint(of, ends, {path: value_at(of, path) for path in paths}, device)


def test_a_sphere_that_flies_alone_goes_on_as_it_began():
    """A free sphere continues at its velocity; the other one presses the ball, so that all other values matter."""
    of = with_spheres({"position": (0.0, 9.0, 0.0)}, {})
    paths = [*(path for path in PATHS if "sphere.0" not in path), "sphere.0.velocity.1", "sphere.0.position.1"]
    found = bw.gradient(of, of=paths, loss=far_and_high).gradients
    assert found["sphere.0.position.1"][0] == pytest.approx(1.0, rel=1e-5)
    assert found["sphere.0.velocity.1"][0] == pytest.approx(1.0 + of.frames / 60.0, rel=1e-5)


@pytest.mark.full
@pytest.mark.parametrize("case", CASES_OF_SPHERES)
def test_spheres_that_exchange_momentum_have_the_slopes_of_a_run_in_double_precision(case: str, device: str):
    """A ball presses a sphere to the ground that lands beneath it, and rubs on that and on another."""
    of, paths = CASES_OF_SPHERES[case]
    require_slopes(of, paths, bw.gradient(of, of=paths, loss=ends, device=device), of)


@pytest.mark.full
@pytest.mark.parametrize("case", CASES_OF_SPHERES)
def test_an_exchange_in_a_batch_has_the_gradients_and_frames_that_it_has_alone(case: str, device: str):
    of, paths = CASES_OF_SPHERES[case]
    varied = {"sphere.0.mass": np.array([0.2, 0.4]), "balloon.0.velocity.0": np.array([0.1, -0.2])}
    found = bw.gradient(of, of=paths, loss=ends, world_count=2, vary=varied, device=device)
    alone = {path: values[1:] for path, values in varied.items()}
    single = bw.gradient(of, of=paths, loss=ends, vary=alone, device=device)
    assert single.loss[0] == found.loss[1] != found.loss[0]
    assert all(single.gradients[path][0] == found.gradients[path][1] for path in paths)
    told = bw.simulate(of, device=device, schedule="gather", world_count=2, vary=varied)
    np.testing.assert_array_equal(found.trajectories.points[0], told.points[0])
    np.testing.assert_array_equal(found.trajectories.sphere_positions, told.sphere_positions)


@pytest.mark.full
def test_gradients_by_friction_of_spheres_that_exchange_momentum(device: str):
    """The first sphere rubs on the ball and the ground, the second on the ball alone."""
    of, paths = exchange(), ["sphere.0.friction", "sphere.1.friction"]
    found = bw.gradient(of, of=paths, loss=ends, device=device)
    for path in paths:
        more, less = (ends_in_float64(of, {path: value_of(of, path) + side * 1e-6}) for side in (1.0, -1.0))
        assert found.gradients[path][0] == pytest.approx((more - less) / 2e-6, rel=2e-5)


def test_friction_of_a_sphere_that_meets_faces_as_a_ridge_is_refused():
    with pytest.raises(bw.InputError, match=r"sphere\.1\.friction: cannot be derived by yet"):
        bw.gradient(between_corners(), of=["sphere.1.friction"], loss=far)
