"""Small random meshes: closed quads, closed triangles, and open sheets."""

import itertools
from typing import Any

import numpy as np
from hypothesis import strategies as st
from numpy.typing import NDArray

from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.topology import quad_sphere

Draw = Any
"""Hypothesis's function that draws from a strategy"""
MOST_BLUR = 0.15
"""Random displacement of a mesh's points, over its size"""


@st.composite
def meshes(draw: Draw, family: str) -> PolygonMesh:
    """Draw a small mesh of about unit size: closed quads, closed triangles or an open sheet, with random bumps."""
    if family == "quads":
        mesh = quad_sphere(draw(st.sampled_from((1, 2, 4))), 0.5)
    elif family == "triangles":
        mesh = draw(
            st.sampled_from((octahedron(), in_triangles(quad_sphere(2, 0.5)), in_triangles(quad_sphere(3, 0.5))))
        )
    else:
        mesh = sheet(draw(st.integers(2, 6)))
    blur = draw(st.sampled_from((0.02, 0.0, MOST_BLUR)))
    noise = np.random.default_rng(draw(st.integers(0, 99))).normal(scale=blur, size=mesh.points.shape).clip(-0.2, 0.2)
    bumps = mesh.points * (1.0 + noise[:, :1]) if family != "sheet" else mesh.points + noise
    return listed(bumps.round(6), mesh.face_vertex_counts, mesh.face_vertex_indices)


def octahedron() -> PolygonMesh:
    points = 0.5 * np.concatenate([np.eye(3), -np.eye(3)])
    faces = [(x, y, z) for x, y, z in itertools.product((0, 3), (1, 4), (2, 5))]
    outward = [face if np.linalg.det(points[list(face)]) > 0.0 else face[::-1] for face in faces]
    return listed(points, np.full(8, 3), np.ravel(outward))


def sheet(cells: int) -> PolygonMesh:
    """Return an open level grid of quads, a meter wide."""
    x, z = (axis.ravel() for axis in np.meshgrid(*[np.linspace(-0.5, 0.5, cells + 1)] * 2, indexing="ij"))
    i, j = (axis.ravel() for axis in np.meshgrid(*[np.arange(cells)] * 2, indexing="ij"))
    corner = i * (cells + 1) + j
    quads = np.stack([corner, corner + 1, corner + cells + 2, corner + cells + 1], axis=1)
    return listed(np.stack([x, 0.0 * x, z], axis=1), np.full(len(quads), 4), quads.ravel())


def in_triangles(mesh: PolygonMesh) -> PolygonMesh:
    """Cut each quad of a mesh in two."""
    quads = mesh.face_vertex_indices.reshape(-1, 4)
    triangles = quads[:, [0, 1, 2, 0, 2, 3]].ravel()
    return listed(mesh.points, np.full(len(triangles) // 3, 3), triangles)


def listed(points: NDArray[np.float64], counts: NDArray, corners: NDArray, up: str = "Y") -> PolygonMesh:
    """Return a mesh by its points and faces."""
    return PolygonMesh(points, counts.astype(np.int32), corners.astype(np.int32), up_axis=up, up_known=True)
