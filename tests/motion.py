"""Stages as they are read back: whether USD finds them valid, and their motion."""

from pathlib import Path
from typing import Any

import numpy as np
from pxr import Usd, UsdGeom, UsdValidation

from balloon_warp import Scene, animate


def animated(scene: Scene, path: Path, **options: Any) -> Usd.Stage:
    """Return the stage of a run, on a CPU."""
    animate(scene, path, device="cpu", **options)
    return Usd.Stage.Open(str(path))


def assert_valid(stage: Usd.Stage) -> None:
    """Require that every validator of USD passes."""
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    assert len(validators) >= 20
    errors = UsdValidation.ValidationContext(validators).Validate(stage)
    assert [error.GetMessage() for error in errors] == []


def assert_velocities_are_those_of_the_points(prim: UsdGeom.Mesh, frames_per_second: float) -> None:
    """Check that velocities are central differences of the points, one-sided at both ends, up to float32's rounding."""
    times = prim.GetPointsAttr().GetTimeSamples()
    assert prim.GetVelocitiesAttr().GetTimeSamples() == times
    points = np.array([prim.GetPointsAttr().Get(time) for time in times], dtype=np.float64)
    velocities = np.array([prim.GetVelocitiesAttr().Get(time) for time in times])
    expected = np.gradient(points, 1.0 / frames_per_second, axis=0)
    np.testing.assert_allclose(velocities, expected, rtol=1e-6)
    assert np.abs(expected).max() > 0.0
