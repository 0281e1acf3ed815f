"""Distance of a shape from the target, and its picture with the error as color."""

import io
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sparse
import warp as wp
from numpy.typing import NDArray
from PIL import Image

from balloon_warp.kernels.measure.crossings import unsigned_distances
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.polygon_mesh import Looks
from balloon_warp.mesh.topology import vertex_areas, vertex_normals
from balloon_warp.scene import Balloon, Scene
from balloon_warp.simulator import Simulator
from balloon_warp.tools.compare import Tile, compose_sheet

Values = NDArray[np.float64]
ALONG = 0.1
"""Weight of tangential errors over normal ones: only the shape matters"""
LEAST_WEIGHT = 0.05
"""Least weight of a vertex in a step: of those of no area, too"""


@dataclass(frozen=True)
class Error:
    """Distance between two surfaces, both ways, over the largest size of the target."""

    mean: float
    """Mean over the vertices of both [1]"""
    worst: float
    """Hausdorff distance [1]"""

    def __str__(self) -> str:
        return f"{100.0 * self.mean:.2g}% mean, {100.0 * self.worst:.2g}% worst"


@dataclass(frozen=True)
class Ruler:
    """Measures shapes of a mesh's vertices against the mesh."""

    mesh: PolygonMesh
    in_place: bool = False
    """Whether shapes are held, so that they are measured where they are"""

    @cached_property
    def size(self) -> float:
        """The largest extent [m]."""
        return float(np.ptp(self.mesh.points, axis=0).max())

    @cached_property
    def normals(self) -> Values:
        """Outward, at the vertices, shape (n, 3)."""
        return vertex_normals(self.mesh)

    @cached_property
    def weights(self) -> Values:
        """Area weights of the vertices, 1 in the mean, shape (n,)."""
        areas = vertex_areas(self.mesh)
        return areas / areas.mean()

    @cached_property
    def squares(self) -> Any:
        """Weights of errors by area, with less for tangential ones, shape (3 n, 3 n)."""
        normals, count = self.normals, len(self.normals)
        blocks = (1.0 - ALONG) * normals[:, :, None] * normals[:, None, :] + ALONG * np.eye(3)
        blocks *= np.maximum(self.weights, LEAST_WEIGHT)[:, None, None]
        return sparse.bsr_matrix((blocks, np.arange(count), np.arange(count + 1))).tocsc()

    def cost(self, points: Values) -> float:
        """Return the weighted mean squared error of a shape in place, over the squared size."""
        error = self.mesh.points - points
        normal = (error * self.normals).sum(axis=1) ** 2
        squared = (1.0 - ALONG) * normal + ALONG * (error**2).sum(axis=1)
        return float((self.weights * squared).mean()) / self.size**2

    @cached_property
    def triangles(self) -> NDArray[np.int64]:
        """Triangles that cover the mesh, quads by one split, shape (t, 3)."""
        starts = np.cumsum(self.mesh.face_vertex_counts) - self.mesh.face_vertex_counts
        found = []
        for size in np.unique(self.mesh.face_vertex_counts).tolist():
            first = starts[self.mesh.face_vertex_counts == size]
            for k in range(1, size - 1):
                found.append(self.mesh.face_vertex_indices[first[:, None] + [0, k, k + 1]])
        return np.concatenate(found).astype(np.int64)

    def aligned(self, points: Values) -> Values:
        """Return the points moved and turned onto the mesh's, unless they are measured in place."""
        return points if self.in_place else aligned(points, self.mesh.points)

    def error(self, points: Values) -> Error:
        """Return the error of a shape, wherever it is, or in place."""
        return Error(*map(float, self._statistics(self.distances(points))))

    def distances(self, points: Values) -> Values:
        """Return distances between each shape's vertices and the other surface, over the size, shape (2 n,)."""
        there, wanted = self.aligned(points), self.mesh.points
        both = [self._apart(there, wanted), self._apart(wanted, there)]
        return np.concatenate(both) / self.size

    def _statistics(self, distances: Values) -> tuple[float, float]:
        return distances.mean(), distances.max()

    def _apart(self, points: Values, surface: Values) -> Values:
        corners = wp.array(surface, dtype=wp.vec3, device="cpu")
        indices = wp.array(self.triangles.ravel(), dtype=wp.int32, device="cpu")
        mesh, found = wp.Mesh(corners, indices), wp.zeros(len(points), dtype=float, device="cpu")
        asked = [mesh.id, wp.array(points, dtype=wp.vec3, device="cpu"), 1.0e6]
        wp.launch(unsigned_distances, len(points), asked, [found], device="cpu")
        return found.numpy().astype(np.float64)


def aligned(points: Values, to: Values) -> Values:
    """Return the points moved and turned as near to others as can be (Kabsch)."""
    here, there = points - points.mean(axis=0), to - to.mean(axis=0)
    u, _, v = np.linalg.svd(here.T @ there)
    turn = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ v))]) @ v
    return here @ turn + to.mean(axis=0)


SIZE = (480, 420)
FULL = 0.02
"""Error over the size from which on the color is the last"""
BANDS = np.array([[0.10, 0.42, 0.62], [0.55, 0.75, 0.72], [0.95, 0.85, 0.45], [0.85, 0.35, 0.12], [0.45, 0.02, 0.08]])
"""Linear RGB from zero error to `FULL`"""
SAMPLES = 4


def error_picture(
    ruler: Ruler, shapes: Sequence[tuple[str, Values]], plain: Sequence[tuple[str, Values]] = ()
) -> Image.Image:
    """Draw the wanted shape and others beside it, each colored by how far it is off.

    Args:
        ruler: of the wanted shape.
        shapes: label above each, and its points, shape (n, 3).
        plain: the same of shapes that are drawn as they are, as large as the wanted one.
    """
    tiles = [Tile(["wanted"], _drawn(ruler, ruler.mesh.points, None), "")]
    for label, points in plain:
        larger = points * (ruler.size / float(np.ptp(points, axis=0).max()))
        tiles.append(Tile([label], _drawn(ruler, larger, None), ""))
    for label, points in shapes:
        off = ruler.distances(points)[: len(points)]
        line = f"{ruler.error(points)}; blue 0, red {100.0 * FULL:g}% and more"
        tiles.append(Tile([label, line], _drawn(ruler, points, off), ""))
    return Image.fromarray(compose_sheet(tiles, len(tiles), SIZE))


def colored(mesh: PolygonMesh, off: Values) -> PolygonMesh:
    """Return the mesh with the color of each vertex's error, a fraction of the size, shape (n,)."""
    colors = linear_colors(off)
    none = np.full(len(mesh.face_vertex_indices), -1, dtype=np.int32)
    return replace(mesh, looks=Looks((), none, colors[mesh.face_vertex_indices].astype(np.float32)))


def linear_colors(off: Values) -> Values:
    """Return the color of each error, linear RGB, shape (n, 3)."""
    place = np.clip(off / FULL, 0.0, 1.0) * (len(BANDS) - 1)
    return np.stack([np.interp(place, np.arange(len(BANDS)), band) for band in BANDS.T], axis=1)


def error_colors(off: Values) -> Values:
    """Return the color of each error in sRGB, shape (n, 3)."""
    linear = linear_colors(off)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1.0 / 2.4) - 0.055)


def stacked(above: Image.Image, below: Image.Image) -> Image.Image:
    """Stack one picture above another of the same width."""
    height = round(below.height * above.width / below.width)
    image = Image.new("RGB", (above.width, above.height + height), (255, 255, 255))
    image.paste(above, (0, 0))
    image.paste(below.resize((above.width, height), Image.Resampling.LANCZOS), (0, above.height))
    return image


def _drawn(ruler: Ruler, points: Values, off: Values | None) -> NDArray[np.uint8]:
    mesh = replace(ruler.mesh, points=ruler.aligned(points))
    if off is not None:
        mesh = colored(mesh, off)
    balloon = Balloon(mesh=mesh, parts="free", holes="keep", weld=False)
    simulator = Simulator(Scene(balloon=[balloon], gravity=0.0, touch=False), "cpu")
    with Image.open(io.BytesIO(simulator.picture(size=SIZE, samples=SAMPLES))) as image:
        return np.asarray(image.convert("RGB"))
