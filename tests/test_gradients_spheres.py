"""Gradients of free-flying spheres, and refusals."""

from typing import Any

import numpy as np
import pytest
from gradient_scenes import CASES, PRESSED, far

import balloon_warp as bw
from balloon_warp.trajectories import Trajectories

BESIDE, PATHS = CASES["gas beside spheres"]


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


def test_a_sphere_that_flies_alone_goes_on_as_it_began():
    """A free sphere continues at its velocity; the other one presses the ball, so that all other values matter."""
    of = with_spheres({"position": (0.0, 9.0, 0.0)}, {})
    paths = [*(path for path in PATHS if "sphere.0" not in path), "sphere.0.velocity.1", "sphere.0.position.1"]
    found = bw.gradient(of, of=paths, loss=far_and_high).gradients
    assert found["sphere.0.position.1"][0] == pytest.approx(1.0, rel=1e-5)
    assert found["sphere.0.velocity.1"][0] == pytest.approx(1.0 + of.frames / 60.0, rel=1e-5)


def test_spheres_that_meet_are_refused():
    of = with_spheres({"position": (1.0, 2.5, 0.1)}, {})
    with pytest.raises(bw.InputError, match="spheres that meet each other or an obstacle have no adjoint yet"):
        bw.gradient(of, of=PATHS, loss=far)


def test_spheres_that_exchange_momentum_are_refused():
    of = BESIDE.model_copy(update={"contact": "impulse"})
    with pytest.raises(bw.InputError, match="`roll` of spheres that exchange momentum has no adjoint yet"):
        bw.gradient(of, of=PATHS, loss=far)


def test_friction_of_a_sphere_is_refused():
    with pytest.raises(bw.InputError, match=r"sphere\.1\.friction: cannot be derived by yet"):
        bw.gradient(BESIDE, of=["sphere.1.friction"], loss=far)
