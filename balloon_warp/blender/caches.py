"""Frames of a bake as point caches, each in the axes of its object."""

import itertools
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from balloon_warp.blender.addon.point_cache import PointCache
from balloon_warp.blender.addon.request import NEVER, tears_of
from balloon_warp.blender.request import Cached, Request
from balloon_warp.errors import InputError
from balloon_warp.frame import Frame
from balloon_warp.mesh import PolygonMesh
from balloon_warp.run.checkpoints import Part


class PointCaches:
    """Output of a bake: a cache for each object that moves.

    Args:
        request: with the objects.
        folder: of the caches.
    """

    stage = None

    def __init__(self, request: Request, folder: Path):
        self._request, self._folder = request, folder
        self._caches: list[PointCache] = []
        self._poses: NDArray[np.float64] = np.empty((0, 7))
        """Poses of bodies at the start"""
        self._tears = [Tears(each, folder) for each in request.cached if request.bursts(each)]

    def write(self, frame: Frame) -> None:
        """Write the next frame.

        Raises:
            InputError: a file cannot be written.
        """
        if frame.number == 0:
            self._poses = frame.body_poses.astype(np.float64)
        try:
            self._open()
            for each, cache in zip(self._request.cached, self._caches, strict=True):
                cache.write(frame.number, local_points(each, frame, self._poses, self._request.meters))
            for tears in self._tears:
                tears.write(frame)
        except OSError as error:
            raise InputError(f"{self._folder}: cannot be written: {error.strerror}") from None

    def rows(self, part: Part) -> Mapping[str, NDArray]:
        """Make sure that the caches are safe, and return the rows of earlier frames that later ones need."""
        for cache in self._caches:
            cache.sync()
        return {"poses": self._poses} | {each.path.name: each.frames for each in self._tears}

    def take_rows(self, part: Part, saved: Mapping[str, NDArray]) -> None:
        """Take a part that was written.

        Raises:
            InputError: a cache does not have it.
        """
        self._open()
        self._poses = saved["poses"]
        for tears in self._tears:
            tears.frames = saved[tears.path.name]
        for cache in self._caches:
            if cache.sample_count < part.frames.stop:
                raise InputError(
                    f"{cache.path}: has {cache.sample_count} frames; expected {part.frames.stop} to continue from: "
                    "bake from the start"
                )

    def close(self) -> None:
        """Close the files."""
        for cache in self._caches:
            cache.close()

    def _open(self) -> None:
        if not self._caches:
            self._caches = [
                PointCache(self._folder / each.file, len(each.mesh.points)) for each in self._request.cached
            ]


class Tears:
    """Frames in which faces of a balloon tear, in a file beside its cache.

    Args:
        each: the balloon.
        folder: of the caches.
    """

    def __init__(self, each: Cached, folder: Path):
        self._each, self.path = each, tears_of(folder / each.file)
        self.frames = np.full(each.mesh.face_count, NEVER, np.float32)
        """Frames after the start, of each face of Blender's mesh"""

    def write(self, frame: Frame) -> None:
        """Write the faces that are torn in a frame for the first time.

        Raises:
            OSError: the file cannot be written.
        """
        number = self._each.number
        torn = torn_faces(self._each.mesh, frame.meshes[number], frame.torn[number])
        self.frames[torn & (self.frames > frame.number)] = frame.number
        whole = self.path.with_suffix(".next")
        self.frames.astype("<f4").tofile(whole)
        os.replace(whole, self.path)


class LatestFrame:
    """Output of a preview: caches that have the latest frame alone, and appear whole.

    Args:
        request: with the objects.
        folder: of the caches.
        begin: of their names.
    """

    def __init__(self, request: Request, folder: Path, begin: str):
        self._request, self._folder, self._begin = request, folder, begin
        self._poses: NDArray[np.float64] | None = None

    def write(self, frame: Frame) -> None:
        """Write a frame in place of the last.

        Raises:
            InputError: a file cannot be written.
        """
        if self._poses is None:
            self._poses = frame.body_poses.astype(np.float64)
        for each in self._request.cached:
            path = self._folder / f"{self._begin}{each.file}"
            try:
                cache = PointCache(path.with_suffix(".next"), len(each.mesh.points))
                cache.write(0, local_points(each, frame, self._poses, self._request.meters))
                cache.close()
                os.replace(cache.path, path)
            except OSError as error:
                raise InputError(f"{path}: cannot be written: {error.strerror}") from None


def local_points(each: Cached, frame: Frame, first: NDArray[np.float64], meters: float) -> NDArray[np.float32]:
    """Return an object's points in a frame in its own axes and units, shape (n, 3).

    Args:
        first: Poses of bodies at the start, as `Frame.body_poses`.
        meters: Length of Blender's unit [m].
    """
    if each.table == "body":
        points = moved(each.mesh.points, first[each.number], frame.body_poses[each.number])
    else:
        points = frame.points[each.number].astype(np.float64)
    place = each.places[min(frame.number, len(each.places) - 1)]
    return np.asarray(np.linalg.solve(place[:3, :3], (points / meters - place[:3, 3]).T).T, dtype=np.float32)


def torn_faces(given: PolygonMesh, simulated: PolygonMesh, torn: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which faces of a mesh are torn, of those that the simulation made of them, shape (face_count,).

    Args:
        torn: Mask of the faces of the simulated mesh, which was repaired, and has the same vertices.
    """
    gone = set(itertools.compress(_corner_sets(simulated), torn))
    return np.array([corners in gone for corners in _corner_sets(given, simulated.stand_ins)])


def _corner_sets(mesh: PolygonMesh, stand_ins: NDArray[np.int64] | None = None) -> list[frozenset[int]]:
    corners = mesh.face_vertex_indices if stand_ins is None else stand_ins[mesh.face_vertex_indices]
    faces = np.split(corners, np.cumsum(mesh.face_vertex_counts)[:-1])
    return [frozenset(face.tolist()) for face in faces]


def moved(points: NDArray[np.float64], before: NDArray[Any], after: NDArray[Any]) -> NDArray[np.float64]:
    """Return points that go along from one pose to another: place [m] and quaternion (x, y, z, w)."""
    from scipy.spatial.transform import Rotation  # slow to import, and few bakes have bodies

    turn = Rotation.from_quat(after[3:]) * Rotation.from_quat(before[3:]).inv()
    return np.asarray(turn.apply(points - before[:3]) + after[:3], dtype=np.float64)
