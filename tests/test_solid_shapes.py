"""Shapes of obstacles and bodies: where they are thin, and the points on which they stand."""

from pathlib import Path

import numpy as np
import pytest
from meshes import cube, joined, quad_sphere

import balloon_warp.scenes
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.load import load_mesh
from balloon_warp.model.body_samples import MOST_SAMPLES, sample
from balloon_warp.model.obstacles import ObstacleShape, shape_obstacle
from balloon_warp.model.thinness import is_thin
from balloon_warp.scene import Balloon, Obstacle, Scene

UP = np.array([0.0, 1.0, 0.0])


def solid(mesh: PolygonMesh) -> ObstacleShape:
    """Return an obstacle of that mesh."""
    return shape_obstacle(0, Obstacle(mesh=mesh), Scene(balloon=[Balloon(mesh=quad_sphere(1))]))


def block(width: float, depth: float, height: float, x: float = 0.0, y: float = 0.0) -> PolygonMesh:
    """Return a block of faces outward, of some size, with its middle at a place."""
    points = cube().points
    points = (points - points.mean(axis=0)) / np.ptp(points, axis=0)
    return PolygonMesh(
        points * [width, height, depth] + [x, y, 0.0], cube().face_vertex_counts, cube().face_vertex_indices
    )


def test_a_large_thing_with_thin_parts_is_thin() -> None:
    """A top of 40 mm, and legs of 50 mm, though the table is 0.7 m high and 1 m wide."""
    legs = [block(0.05, 0.05, 0.7, x, -0.4) for x in (-0.4, 0.4)]
    table = solid(joined(block(1.0, 1.0, 0.04), *legs))
    assert is_thin(table, 0.1)
    assert not is_thin(table, 0.03)


@pytest.mark.parametrize("mesh", [block(1.0, 1.0, 1.0), quad_sphere(8, 0.5)])
def test_what_is_thick_everywhere_is_not_thin(mesh: PolygonMesh) -> None:
    assert not is_thin(solid(mesh), 0.5)
    assert is_thin(solid(mesh), 1.01)


def test_a_mesh_of_many_vertices_stands_on_its_hull() -> None:
    """The turtle of 2,898 vertices: no plane that it lies on is more than the rounding of an edge into it."""
    turtle = solid(load_mesh(Path(balloon_warp.scenes.__path__[0]) / "turtle.obj"))
    samples = sample(turtle, UP)
    assert len(samples.points) == MOST_SAMPLES
    ways = np.random.default_rng(0).normal(size=(500, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    assert turtle.mesh is not None
    whole = (turtle.mesh.points @ ways.T).max(axis=0)
    stands = samples.points[: samples.outermost]
    held = (stands[:, :3] @ ways.T + stands[:, 3:]).max(axis=0)
    assert (whole - held).max() < 1e-3 * turtle.reach
