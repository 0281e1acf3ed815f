"""Gradients through balloons that touch, against differences of a run in double precision."""

from typing import Any

import numpy as np
import pytest
from dot_products import require_adjoint
from meshes import mesh_of, quad_sphere
from reference_runs import run
from touching import VACUUM

import balloon_warp as bw
from balloon_warp.trajectories import Trajectories

RNG = np.random.default_rng(3)
WEIGHTS = [RNG.uniform(0.5, 1.5, (98, 1)) for _ in range(2)]
STARTS = ["balloon.0.velocity.0", "balloon.0.velocity.1", "balloon.1.position.2", "balloon.0.rotation.1"]
SKINS = ["balloon.0.mass", "balloon.1.mass", "balloon.0.stiffness.structural", "balloon.1.stiffness.shear"]
TOUCH = ["touch.friction", "touch.thickness", "touch.stiffness"]


def pair(
    frames: int = 3, substeps: int = 32, speed: float = 2.0, apart: float = 1.03, meshes: tuple[int, int] = (2, 2),
    **touch: Any,
) -> bw.Scene:  # fmt: skip
    """Return two balls of springs that collide off their centers, one turning; substeps take as long in all scenes."""
    firm: dict[str, Any] = {
        "damping": 0.05, "inflation": bw.Inflation(pressure=20.0),
        "stiffness": {"structural": 100.0, "shear": 50.0, "flexion": 20.0},
    }  # fmt: skip
    left: dict[str, Any] = {"position": (-apart, 1.0, 0.05), "velocity": (speed, 0.3, 0.0), "mass": 0.05, **firm}
    right: dict[str, Any] = {"position": (apart, 1.1, 0.05), "velocity": (-speed, 0.0, 0.1), "mass": 0.08, **firm}
    turning: dict[str, Any] = {"rotation": (0.0, 20.0, 10.0), "angular_velocity": (0.0, 2.0, 5.0)}
    first, second = (quad_sphere(count) for count in meshes)
    return bw.Scene(
        balloon=[bw.Balloon(mesh=first, **left, **turning), bw.Balloon(mesh=second, **right)],
        frames=frames, frames_per_second=1920.0 / substeps, substeps=substeps,
        touch=bw.Touch(itself=False, **touch), **VACUUM,
    )  # fmt: skip


def pinched() -> bw.Scene:
    """Return a flat balloon whose walls are pushed together until they touch from within; each frame searches anew.

    After 32 frames differences in double precision vary by 1.7e-4, as particles start 0.1 µm elsewhere; after 20 by
    1.5e-5.
    """
    ball = quad_sphere(4, 0.5)
    points = ball.points * (1.0, 1.0, 0.4) + np.random.default_rng(1).normal(size=ball.points.shape) * 0.004
    amid = np.linalg.norm(points[:, :2], axis=1) < 0.25
    balloon = bw.Balloon(
        mesh=mesh_of(points, ball.face_vertex_indices.reshape(-1, 4).tolist()), mass=0.05, damping=0.05,
        velocity=(0.3, 0.2, 0.1), angular_velocity=(1.0, 3.0, 2.0), inflation=bw.Inflation(pressure=1.0),
        stiffness={"structural": 60.0, "shear": 30.0, "flexion": 10.0},
    )  # fmt: skip
    forces: list[dict[str, Any]] = [
        {"particles": np.flatnonzero(amid & (side * points[:, 2] > 0.0)).tolist(),
         "newtons": (0.3 * side, 0.5 * side, -side)}
        for side in (1.0, -1.0)
    ]  # fmt: skip
    skin = bw.Touch(itself=True, edges=False, thickness=0.02, stiffness=250.0)
    return bw.Scene(
        balloon=[balloon], force=forces, frames=20, frames_per_second=480.0, substeps=4, touch=skin, **VACUUM
    )


def crossing(**touch: Any) -> bw.Scene:
    """Return two cubes that collide edge on edge, across, and bounce off."""
    of = pair(meshes=(1, 1), edges=True, **touch)
    turns = ((3.0, 5.0, 45.0), (0.0, 45.0, 4.0))
    places = ((-0.85, 1.0, 0.05), (0.85, 1.05, 0.0))
    cubes = [
        cube.model_copy(update={"rotation": turn, "angular_velocity": (0.0, 0.0, 0.0), "position": place})
        for cube, turn, place in zip(of.balloon, turns, places, strict=True)
    ]
    return of.model_copy(update={"balloon": cubes})


def on_the_ground() -> bw.Scene:
    """Return a flat plate on the ground, into which a cube that falls on it presses its corners."""
    of, cube = pair(1, 24, meshes=(1, 1), edges=True, thickness=0.02, stiffness=300.0), quad_sphere(1)
    thin = cube.points * (1.0, 0.0005 / np.abs(cube.points[:, 1]).max(), 1.0)
    plate = {
        "mesh": mesh_of(thin, cube.face_vertex_indices.reshape(-1, 4).tolist()), "position": (0.0, 0.0008, 0.0),
        "velocity": (0.2, 0.0, 0.1), "rotation": (0.0, 20.0, 0.0), "angular_velocity": (0.0, 0.0, 0.0),
        "inflation": bw.Inflation(pressure=0.1),
    }  # fmt: skip
    above = {"position": (0.15, 0.885, 0.1), "velocity": (0.1, -3.0, 0.0), "rotation": (3.0, 10.0, 41.0)}
    balloons = [each.model_copy(update=more) for each, more in zip(of.balloon, (plate, above), strict=True)]
    return of.model_copy(update={"balloon": balloons, "ground": bw.Ground(friction=0.0)})


CASES = {
    "a substep": (pair(1, 1, apart=0.95, thickness=0.3, stiffness=300.0), [*STARTS[:3], *SKINS[:2], *TOUCH]),
    "of their own": (pair(), [*STARTS[:2], *SKINS[1:], "touch.friction"]),
    "as said": (pair(thickness=0.06, stiffness=300.0), [*STARTS[:2], *SKINS[1:3], *TOUCH]),
    "crowded": (pair(2, speed=5.0, meshes=(4, 4), thickness=0.16), [*STARTS[1:3], *SKINS[::2], *TOUCH[:2]]),
    "itself": (pinched(), ["balloon.0.mass", "touch.thickness"]),
    "edges": (crossing(thickness=0.03), [STARTS[1], *SKINS[1:3], *TOUCH[:2]]),
    "on the ground": (on_the_ground(), [STARTS[0], *SKINS[:2], *TOUCH[:2], "ground.height"]),
    "for long": (pair(12, friction=0.0), [STARTS[0], *SKINS[::2]]),
}
"""Scenes of 1 to 384 substeps: contacts that begin and end, share where more meet than a step allows for, and rub"""


def far(moved: Trajectories) -> tuple[Any, dict[str, Any]]:
    """Return a loss of places and velocities at the end, with its derivatives."""
    slopes = [[np.zeros(each.shape) for each in parts] for parts in (moved.points, moved.velocities)]
    loss: Any = 0.0
    for parts, found, scale in zip((moved.points, moved.velocities), slopes, (1.0, 0.1), strict=True):
        for number, part in enumerate(parts):
            last, weights = part[..., -1, :, :].astype(float), scale * WEIGHTS[number][: part.shape[-2]]
            found[number][..., -1, :, :] = 2.0 * weights * last
            loss = loss + (weights * last**2).sum(axis=(-2, -1))
    return loss, {"points": slopes[0], "velocities": slopes[1]}


def far_in_float64(of: bw.Scene, values: dict[str, float]) -> float:
    loss = 0.0
    for parts, scale in zip(run(of, values)[:2], (1.0, 0.1), strict=True):
        loss += sum(
            scale * (WEIGHTS[number][: part.shape[1]] * part[-1] ** 2).sum() for number, part in enumerate(parts)
        )
    return loss


def value_at(of: bw.Scene, path: str) -> float:
    value: Any = of
    for name in path.split("."):
        value = value[int(name)] if name.isdecimal() else getattr(value, name)
    return float(value)


@pytest.mark.full
@pytest.mark.parametrize("case", CASES)
def test_gradients_are_the_slopes_of_a_run_in_double_precision(case: str, device: str):
    """Gradients agree to 1e-4 of themselves, or to 1e-5 of what the largest says by its own value: a small one is the
    difference of large ones, of which states in float32 leave less."""
    of, paths = CASES[case]
    found = bw.gradient(of, of=paths, loss=far, device=device)
    assert found.loss[0] == pytest.approx(far_in_float64(of, {}), rel=1e-5)
    values = {path: value_at(of, path) for path in paths}
    sizes = {path: abs(value) or 1.0 for path, value in values.items()}
    told = {}
    for path in paths:
        h = 1e-6 * sizes[path]
        more, less = (far_in_float64(of, {path: values[path] + sign * h}) for sign in (1.0, -1.0))
        told[path] = (more - less) / (2.0 * h)
    most = max(abs(told[path]) * sizes[path] for path in paths)
    for path in paths:
        assert found.gradients[path][0] == pytest.approx(told[path], rel=1e-4, abs=1e-5 * most / sizes[path]), path


@pytest.mark.full
@pytest.mark.parametrize("case", ["as said", "edges"])
def test_what_a_shift_of_the_start_does_to_the_end_is_what_the_end_says_of_the_start(case: str, device: str):
    of, paths = CASES[case]

    def ends(values: dict[str, float], shifts: Any) -> Any:
        return *([part[-1] for part in parts] for parts in run(of, values, shifts)[:2]), {}

    require_adjoint(of, ends, {path: value_at(of, path) for path in paths}, device)


@pytest.mark.full
def test_a_world_in_a_batch_has_the_gradients_that_it_has_alone(device: str):
    """Each world's gradients are the same to the bit alone, and its frames those without gradients."""
    of, paths = CASES["as said"]
    varied = {"balloon.0.velocity.0": np.array([2.0, 1.0]), "touch.friction": np.array([0.3, 0.5])}
    found = bw.gradient(of, of=paths, loss=far, world_count=2, vary=varied, device=device)
    for world in range(2):
        alone = {path: values[world : world + 1] for path, values in varied.items()}
        single = bw.gradient(of, of=paths, loss=far, vary=alone, device=device)
        assert single.loss[0] == found.loss[world]
        for path in paths:
            assert single.gradients[path][0] == found.gradients[path][world], path
    assert found.loss[0] != found.loss[1]
    told = bw.simulate(of, device=device, schedule="gather", world_count=2, vary=varied)
    for ours, theirs in zip(found.trajectories.points, told.points, strict=True):
        np.testing.assert_array_equal(ours, theirs)


@pytest.mark.full
def test_balloons_that_touch_by_default_are_derived():
    """Balloons of a scene without the table `touch` touch, as their derivatives show."""
    of = pair(1, 1, apart=0.94).model_copy(update={"touch": None})
    apart = of.model_copy(update={"touch": False})
    paths = ["balloon.0.velocity.0"]
    found, told = (bw.gradient(each, of=paths, loss=far, device="cpu").gradients[paths[0]] for each in (of, apart))
    assert found[0] != told[0]
