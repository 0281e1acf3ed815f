"""Geometry that is drawn of a model, computed from its points."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.geometry import triangulate, vertex_normals
from balloon_warp.model import Model
from balloon_warp.model.strings import ANCHORED, anchors_of
from balloon_warp.outputs.usd.string_curve import string_curve
from balloon_warp.viewer.colors import SPRINGS, STRAIN_BOUNDS
from balloon_warp.viewer.picture import Picture

Lines = NDArray[np.float32]
"""Line segments [m], shape (count, 2, 3)"""


class Drawing:
    """The parts of a model that do not change, and the lines and measures of a picture's points."""

    def __init__(self, model: Model):
        self.model = model
        self.triangles, self.triangle_faces = zip(*(triangulate(shape.mesh) for shape in model.shapes), strict=True)
        """Triangles of each balloon, and the face of each triangle"""
        self.all_triangles = np.concatenate(
            [part + offset for part, offset in zip(self.triangles, model.particle_offsets, strict=False)]
        )
        """Triangles of all balloons together"""
        springs = [shape.springs for shape in model.shapes]
        ends = [each.pairs + offset for each, offset in zip(springs, model.particle_offsets, strict=False)]
        rest_lengths = np.concatenate([each.rest_lengths for each in springs])
        self._ends = np.concatenate(ends)[rest_lengths > 0.0]
        self._rest_lengths = rest_lengths[rest_lengths > 0.0]

    def springs(self, picture: Picture, kind: str) -> Lines:
        """Return all springs of one kind."""
        number = list(SPRINGS).index(kind)
        parts = []
        for shape, points in zip(self.model.shapes, picture.frame.points, strict=True):
            parts.append(points[shape.springs.pairs[shape.springs.kind == number]])
        return np.concatenate(parts)

    def normals(self, picture: Picture, length: float) -> Lines:
        """Return the normals of all particles."""
        parts = []
        for shape, points in zip(self.model.shapes, picture.frame.points, strict=True):
            normals = vertex_normals(replace(shape.mesh, points=points.astype(np.float64)))
            parts.append(np.stack([points, points + length * normals], axis=1))
        return np.concatenate(parts).astype(np.float32)

    def net_forces(self, picture: Picture, length: float) -> Lines:
        """Return the net forces on all particles; the largest twentieth is drawn `length` long."""
        points, forces = np.concatenate(picture.frame.points), np.concatenate(picture.frame.net_forces)
        sizes = np.linalg.norm(forces, axis=1, keepdims=True)
        longest = max(float(np.percentile(sizes, 95.0)), 1e-12)
        return np.stack([points, points + forces * (length / np.maximum(sizes, longest))], axis=1).astype(np.float32)

    def strain_bands(self, picture: Picture, number: int) -> list[NDArray[np.int32]]:
        """Return the triangles of one balloon, in as many groups as there are bands of strain."""
        shape, points = self.model.shapes[number], picture.frame.points[number]
        structural = shape.springs.kind == 0
        pairs, rest = shape.springs.pairs[structural], shape.springs.rest_lengths[structural]
        stretch = np.linalg.norm(points[pairs[:, 1]] - points[pairs[:, 0]], axis=1) / np.maximum(rest, 1e-12)
        ends, twice = pairs.T.ravel(), np.tile(stretch, 2)
        if shape.membrane.count:
            ends, twice = shape.membrane.corners.ravel(), np.repeat(shape.membrane.stretches(points), 3)
        count = np.maximum(np.bincount(ends, minlength=len(points)), 1)
        of_particles = np.bincount(ends, twice, len(points)) / count
        band = np.digitize(of_particles[self.triangles[number]].mean(axis=1), STRAIN_BOUNDS)
        return [self.triangles[number][band == which] for which in range(len(STRAIN_BOUNDS) + 1)]

    def string_curves(self, picture: Picture) -> dict[int, NDArray[np.float32]]:
        """Return the points along the strings that are there [m], by their numbers."""
        model, points = self.model, np.concatenate(picture.frame.points)
        ground = picture.scene.ground.height if picture.scene.ground else -np.inf
        strong = picture.model.parameters["string_stiffness"].numpy()[0] > 0.0
        held, lengths = picture.model.string_particle.numpy(), picture.model.parameters["string_length"].numpy()[0]
        anchors = picture.frame.string_anchors
        return {
            string: string_curve(anchors[string], points[held[string]], lengths[string], model.scene.up, ground)
            for string in np.flatnonzero(strong).tolist()
        }

    @staticmethod
    def strings(picture: Picture, drawn: dict[int, NDArray[np.float32]]) -> tuple[Lines, NDArray[np.bool_]]:
        """Return the segments of strings, and which of them are hands'.

        Args:
            drawn: points along them, by their numbers.
        """
        curves, hands = [np.zeros((0, 2, 3), np.float32)], [np.zeros(0, bool)]
        for string, curve in drawn.items():
            curves.append(np.stack([curve[:-1], curve[1:]], axis=1))
            hands.append(np.full(len(curve) - 1, string in picture.hands))
        return np.concatenate(curves), np.concatenate(hands)

    def measures(self, picture: Picture) -> dict[str, float]:
        """Return volume [m^3] and pressure [Pa] of all balloons, and the largest stretch.

        The stretch is that of springs or of a membrane.
        """
        frame = picture.frame
        points = np.concatenate(frame.points).astype(np.float64)
        corners = points[self.all_triangles]
        sides = corners[:, 1:] - corners[:, :1]
        across = np.cross(sides[:, 0], sides[:, 1])
        starts = np.cumsum([0, *(len(part) for part in self.triangles[:-1])])
        areas = np.add.reduceat(0.5 * np.linalg.norm(across, axis=1), starts)
        volume = float(np.einsum("ij,ij->", corners[:, 0] - points.mean(axis=0), across)) / 6.0
        pushed = [balloon.inflation.kind == "normal_force" for balloon in picture.scene.balloon]
        force = float((np.where(pushed, 0.0, frame.pressures) * areas).sum())
        force += sum(
            float(np.linalg.norm(frame.inflation_forces[number], axis=1).sum()) for number in np.flatnonzero(pushed)
        )
        long = np.linalg.norm(points[self._ends[:, 1]] - points[self._ends[:, 0]], axis=1)
        stretch = float((long / self._rest_lengths).max(initial=0.0))
        for shape, own in zip(self.model.shapes, frame.points, strict=True):
            if shape.membrane.count:
                stretch = max(stretch, float(shape.membrane.stretches(own).max(initial=0.0)))
        area = float(areas.sum())
        return {"volume": volume, "pressure": force / area if area > 0.0 else 0.0, "stretch": stretch}


def string_reach(model: Model, up: NDArray[np.floating]) -> NDArray[np.floating]:
    """Return the reach of strings: the anchors, and the highest places of their balloons, shape (2 string_count, 3).

    A balloon rises above the anchor by the lengths of its string and itself, or hangs as far below.

    Args:
        up: Unit vector, shape (3,).
    """
    places = {name: model.parameters[name].numpy() for name in ANCHORED}
    anchors = anchors_of(model.scene, model.bodies, places)[0].reshape(-1, 3)[: len(model.scene.string)]
    lengths = model.parameters["string_length"].numpy()[0]
    held = [model.shapes[string.balloon].mesh.points for string in model.scene.string[: len(anchors)]]
    sizes = np.array([np.ptp(points, axis=0).max() for points in held])
    centers = np.array([points.mean(axis=0) for points in held]).reshape(-1, 3)
    sides = np.where((centers - anchors) @ up >= 0.0, 1.0, -1.0)
    return np.concatenate([anchors, anchors + (sides * (lengths + sizes))[:, None] * up])
