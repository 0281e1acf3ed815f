"""Small stage with one of each kind of thing that an export handles; and stages as they are read back."""

from pathlib import Path
from typing import Any

import numpy as np
from meshes import cube, quad_sphere
from pxr import Usd, UsdGeom, UsdValidation

from balloon_warp import PolygonMesh, Scene, Simulator, StageWriter, animate
from balloon_warp.scene import Balloon, Ground, Inflation, Obstacle, Sphere, String, Water

FRAMES = 6
RATE = 30.0
STRING = ("String_0", "String_0_Knot")
TURNS = [(0.0, (0, 0, 0), (0, 0, 0)), (0.2, (1, 0, 0), (0, 90, 0))]
BALL = quad_sphere(3)
UV = np.random.default_rng(1).random((len(BALL.face_vertex_indices), 2)).astype(np.float32)


def scene(**fields) -> Scene:
    """Return a scene with one of each kind of motion; the second sphere appears after two frames."""
    textured = PolygonMesh(BALL.points, BALL.face_vertex_counts, BALL.face_vertex_indices, texture_coordinates=UV)
    fields = {
        "balloon": [
            Balloon(mesh=textured, name="ball", position=(0, 2, 0), inflation=Inflation(k_normal=0.2)),
            Balloon(mesh=cube(), name="box", position=(4, 3, 0), color=(0.1, 0.2, 0.3)),
        ],
        "sphere": [Sphere(position=(0, 5, 0), radius=0.3), Sphere(position=(2, 5, 0), radius=0.1, start=2.0 / RATE)],
        "string": [String(anchor=(0, 0, 0), length=2.0)],
        "obstacle": [Obstacle(size=(1.0, 0.5, 0.2), position=(-4, 1, 0), motion=TURNS)],
        "ground": Ground(height=-5.0),
        "water": Water(level=-4.0),
        **{"frames": FRAMES, "frames_per_second": RATE, "faces": False, "touch": False},
    } | fields
    return Scene(**fields)


def points(path: Path, prim: str, frame: float) -> np.ndarray:
    """Return the points of a mesh in the stage with Y up."""
    stage = Usd.Stage.Open(str(path))
    found = np.array(UsdGeom.Mesh(stage.GetPrimAtPath(prim)).GetPointsAttr().Get(frame), np.float64)
    return found @ turned(stage)


def turned(stage: Usd.Stage) -> np.ndarray:
    """Return the rotation that turns row vectors of a stage so that Y is up."""
    return np.eye(3) if UsdGeom.GetStageUpAxis(stage) == "Y" else np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])


def animated(scene: Scene, path: Path, **options: Any) -> Usd.Stage:
    """Return the stage of a run, on a CPU."""
    animate(scene, path, device="cpu", **options)
    return Usd.Stage.Open(str(path))


def at_start(scene: Scene, path: Path) -> Usd.Stage:
    """Return the stage of the start alone, for which no kernel of the scene's own is compiled."""
    simulator = Simulator(scene, "cpu")
    with StageWriter(path, simulator.model) as writer:
        writer.write(simulator.read_frame())
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
