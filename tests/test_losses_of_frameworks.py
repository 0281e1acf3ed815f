"""Losses of other frameworks have the values and derivatives of the same in NumPy."""
# pyright: reportAssignmentType=false, reportGeneralTypeIssues=false

from typing import Any

import numpy as np
import pytest
import warp as wp
from gradient_scenes import CASES, N, scene

import balloon_warp as bw
from balloon_warp.lab.gradients.derive import Told, told_by
from balloon_warp.model import plan_model

FRAMES, SPHERES = 4, 2


@wp.kernel
def fast_and_high(
    points: wp.array3d[wp.vec3], pressures: wp.array3d[float], sphere_velocities: wp.array3d[wp.vec3d],
    loss: wp.array[wp.float64],
):  # fmt: skip
    world, frame, particle = wp.tid()
    wp.atomic_add(loss, world, wp.float64(wp.length_sq(points[world, frame, particle])))
    if particle == 0:
        wp.atomic_add(loss, world, wp.float64(pressures[world, frame, 0]) * wp.float64(1e-3))
        wp.atomic_add(loss, world, wp.length_sq(sphere_velocities[world, frame, 1]))


def in_numpy(moved: bw.Trajectories) -> tuple[Any, dict[str, Any]]:
    points, speeds = moved.points[0].astype(float), moved.sphere_velocities.astype(float)
    by_speeds = np.zeros(speeds.shape)
    by_speeds[..., 1, :] = 2.0 * speeds[..., 1, :]
    value = (points**2).sum(axis=(-1, -2, -3)) + (speeds[..., 1, :] ** 2).sum(axis=(-1, -2))
    value = value + 1e-3 * moved.pressures[..., 0].sum(axis=-1)
    slopes = {"points": [2.0 * points], "pressures": np.full(moved.pressures.shape, 1e-3)}
    return value, slopes | {"sphere_velocities": by_speeds}


def of_framework(seen: Any) -> Any:
    """Return the same loss, of tensors or arrays of JAX."""
    value = (seen.points[0] ** 2).sum((-1, -2, -3)) + (seen.sphere_velocities[..., 1, :] ** 2).sum((-1, -2))
    return value + 1e-3 * seen.pressures[..., 0].sum(-1)


def moved_at_random(worlds: int) -> bw.Trajectories:
    rng, alone = np.random.default_rng(8), () if worlds == 1 else (worlds,)
    plan = plan_model(scene())

    def track(*shape: int) -> np.ndarray:
        return rng.normal(size=(*alone, FRAMES, *shape)).astype(np.float32)

    return bw.Trajectories(
        plan.scene, [shape.mesh for shape in plan.shapes], np.arange(FRAMES) / 60.0, [track(N, 3)], [track(N, 3)],
        track(1), track(1).astype(float), track(SPHERES, 3), track(SPHERES, 3), np.arange(worlds),
    )  # fmt: skip


def told_of(loss: Any, worlds: int) -> Told:
    return told_by(loss, moved_at_random(worlds), plan_model(scene()).shapes, worlds)


@pytest.mark.full
@pytest.mark.parametrize("worlds", [1, 2])
@pytest.mark.parametrize("kind", ["kernel", "torch", "jax"])
def test_a_loss_is_that_of_numpy(kind: str, worlds: int):
    """Values and derivatives agree to 1e-5: arrays are float32."""
    if kind != "kernel":
        pytest.importorskip(kind)
    loss = {"torch": bw.losses.of_torch, "jax": bw.losses.of_jax, "kernel": lambda _: fast_and_high}[kind](of_framework)
    for ours, theirs in zip(told_of(loss, worlds), told_of(in_numpy, worlds), strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-5, atol=1e-9)


@wp.kernel
def far_off(volumes: wp.array3d[float], points: wp.array3d[wp.vec3], loss: wp.array[wp.float64]):
    world, frame, balloon = wp.tid()
    wp.atomic_add(loss, world, wp.float64(volumes[world, frame, balloon]))
    wp.atomic_add(loss, world, wp.float64(points[world, frame, 3][1]))


def far_off_in_numpy(moved: bw.Trajectories) -> tuple[Any, dict[str, Any]]:
    by_points = np.zeros(moved.points[0].shape)
    by_points[..., 3, 1] = 1.0
    value = moved.volumes.sum(axis=(-1, -2)) + moved.points[0][..., 3, 1].sum(axis=-1)
    return value, {"points": [by_points], "volumes": np.ones(moved.volumes.shape)}


@pytest.mark.full
def test_a_gradient_of_a_kernel_is_that_of_numpy(device: str):
    of, paths, *_ = CASES["pressure"]
    ours, theirs = (bw.gradient(of, of=paths, loss=loss, device=device) for loss in (far_off, far_off_in_numpy))
    for path in paths:
        assert ours.gradients[path][0] == pytest.approx(theirs.gradients[path][0], rel=1e-4, abs=1e-7), path


@wp.kernel
def of_ages(ages: wp.array3d[float], loss: wp.array[float]):
    world, frame, number = wp.tid()
    wp.atomic_add(loss, world, ages[world, frame, number])


@wp.kernel(enable_backward=False)
def without_adjoint(volumes: wp.array3d[float], loss: wp.array[float]):
    world, frame, number = wp.tid()
    wp.atomic_add(loss, world, volumes[world, frame, number])


@pytest.mark.parametrize(
    ("kernel", "sentence"),
    [(of_ages, "takes ages, loss; expected loss, an array, and"), (without_adjoint, "no adjoint")],
)
def test_a_kernel_that_is_no_loss_is_refused(kernel: wp.Kernel, sentence: str):
    with pytest.raises(bw.InputError, match=sentence):
        told_of(kernel, 1)
