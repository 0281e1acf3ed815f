"""Request of a bake, as the add-on writes it: a scene with meshes in memory, and the point caches of its objects."""

import itertools
import json
import os
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from balloon_warp.blender.addon.request import FILES, LIVE, NEVER, PointCache, tears_of
from balloon_warp.errors import InputError
from balloon_warp.frame import Frame
from balloon_warp.kernels.laws.air import molar_volume
from balloon_warp.mesh import PolygonMesh
from balloon_warp.run.checkpoints import Part
from balloon_warp.run.report import predicted_swellings
from balloon_warp.scene import Balloon, Scene, load_scene
from balloon_warp.simulator import Simulator

SAMPLES = 8
"""Number of stretches whose pressures are foretold; others lie on lines between them"""
LITRE = 1e-3
"""[m^3]"""


def with_keyframes(scene: Scene, number: int, amounts: Sequence[float]) -> Scene:
    """Return the scene with a balloon whose volume, over that of its mesh, or litres of gas follow frames.

    Raises:
        InputError: the balloon has no volume.
    """
    balloon = scene.balloon[number]
    times = (np.arange(len(amounts)) / scene.frames_per_second).tolist()
    if balloon.inflation.kind == "gas":
        air = scene.atmosphere
        moles = np.array(amounts) * LITRE / molar_volume(air.pressure, air.temperature)
        flows = np.gradient(moles, times[1])
        flows[0] += 2.0 * moles[0] / times[1]  # what is there at once comes within the first frame
        said = {"pump": list(zip(times, flows.tolist(), strict=True))}
    else:
        pressures = pressures_of(balloon, scene.up_axis, np.cbrt(amounts) - 1.0)
        said = {"pressure": list(zip(times, pressures, strict=True))}
    return load_scene(scene, {f"balloon.{number}.inflation.{field}": value for field, value in said.items()})


def pressures_of(balloon: Balloon, up_axis: str, stretches: np.ndarray) -> list[float]:
    """Return the pressures that stretch the skin of a balloon so far [Pa].

    Raises:
        InputError: it has no volume.
    """
    known = np.linspace(0.0, max(float(stretches.max()), 1e-6), SAMPLES + 1)
    pressures = [0.0]
    for stretch in known[1:].tolist():
        inflation = balloon.inflation.model_copy(update={"stretch": stretch})
        alone = balloon.model_copy(update={"inflation": inflation, "fixed": []})
        found = predicted_swellings(Scene(up_axis=up_axis, balloon=[alone]))  # pyright: ignore[reportArgumentType]
        if not found:
            raise InputError(f"{balloon.name}: its mesh is open; expected a closed one, whose volume can be animated")
        pressures.append(found[0].pressure)
    return np.interp(stretches, known, pressures).tolist()


@dataclass(frozen=True)
class Cached:
    """Object whose motion is written."""

    name: str
    table: str
    """Table of the scene that it is in: "balloon" or "body\""""
    number: int
    """Number within that table"""
    file: str
    """Name of its cache"""
    mesh: PolygonMesh
    """Mesh at the start, in the world [m]"""
    places: NDArray[np.float64]
    """Matrices from its own axes and units to the world's, one for all frames or each, shape (1 or frames, 4, 4)"""


@dataclass(frozen=True)
class Led:
    """Points of a balloon that an animation leads."""

    balloon: int
    particles: NDArray[np.int64]
    """Numbers of the points, shape (n,)"""
    places: NDArray[np.float64]
    """Places in the world [m], shape (frames, n, 3)"""


@dataclass(frozen=True)
class Request:
    """Scene of a bake, and the caches of its objects."""

    scene: Scene
    cached: list[Cached]
    led: list[Led]
    meters: float
    """Length of Blender's unit [m]"""
    names: dict[str, str]
    """Names of objects by the tables that they became, as "balloon.0\""""

    def bursts(self, each: Cached) -> bool:
        """Return whether an object is a balloon that may burst."""
        return each.table == "balloon" and self.scene.balloon[each.number].material.strength is not None

    def named(self, sentence: str) -> str:
        """Return a sentence with objects' names in place of their tables."""
        for table, name in self.names.items():
            sentence = sentence.replace(f"{table}.mesh: ", f"{name}: ").replace(f"{table}.", f"{name}, ")
        if len(self.names) == 1 and not any(name in sentence for name in self.names.values()):
            return f"{next(iter(self.names.values()))}: {sentence}"  # who is alone is not named
        return sentence


def read_request(folder: Path) -> Request:
    """Read a request.

    Raises:
        InputError: it is not there, is damaged, or has a scene that cannot be; it names the object.
    """
    try:
        told, numbers = (folder / name for name in FILES)
        asked = json.loads(told.read_text(encoding="utf-8"))
        with np.load(numbers) as arrays:
            read = {name: arrays[name] for name in arrays}
        return _request(asked, read)
    except (OSError, KeyError, json.JSONDecodeError, zipfile.BadZipFile) as error:
        raise InputError(f"{folder}: cannot be read: {error}; expected a bake that Blender's panel began") from None


def _request(asked: dict[str, Any], arrays: dict[str, NDArray]) -> Request:
    scene, cached, led, names = asked["scene"], [], [], {}
    for each in asked["things"]:
        key, table, number = each["arrays"], each["table"], each["number"]
        mesh = PolygonMesh(
            points=arrays[f"{key}.points"],
            face_vertex_counts=arrays[f"{key}.counts"],
            face_vertex_indices=arrays[f"{key}.corners"],
            name=each["name"],
            up_axis="Z",
        )
        scene[table][number]["mesh"] = mesh
        names[f"{table}.{number}"] = each["name"]
        if each["file"]:
            where = each["name"], table, number, each["file"]
            cached.append(Cached(*where, mesh=mesh, places=arrays[f"{key}.places"]))
        if len(paths := arrays[f"{key}.paths"]) > 1:
            led.append(Led(number, arrays[f"{key}.pinned"], paths))
    request = Request(Scene.model_construct(), cached, led, asked["meters"], names)
    try:
        whole = Scene(**scene)
        for each in asked["things"]:
            if each["amounts"]:
                whole = with_keyframes(whole, each["number"], each["amounts"])
    except InputError as mistake:
        raise InputError(request.named(str(mistake))) from None
    return Request(whole, cached, led, asked["meters"], names)


class Leading:
    """Gives fixed particles the velocities that take them to their places in the next frame.

    A particle without mass keeps its velocity: no force changes it, and it moves on a line through the frame.

    Args:
        simulator: of the balloons.
        led: their particles.
    """

    def __init__(self, simulator: Simulator, led: Sequence[Led]):
        self._simulator, self._led = simulator, led
        shapes = simulator.model.shapes
        self._firsts = np.cumsum([0, *(shape.mesh.vertex_count for shape in shapes)])
        """Number of each balloon's first particle"""
        self._vertices: list[NDArray[np.int64]] = [
            np.array([shapes[each.balloon].mesh.stand_in(int(particle)) for particle in each.particles]) for each in led
        ]

    def lead(self, frame: Frame) -> None:
        """Lead from a frame to the next; after the last all stay."""
        if not self._led:
            return
        velocities = self._simulator.state.velocities.numpy().copy()
        for each, vertices in zip(self._led, self._vertices, strict=True):
            places = each.places[min(frame.number + 1, len(each.places) - 1)]
            way = places - frame.points[each.balloon][vertices]
            velocities[0, self._firsts[each.balloon] + vertices] = way / self._simulator.model.frame_seconds
        self._simulator.state.velocities.assign(velocities)


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
    """

    def __init__(self, request: Request, folder: Path):
        self._request, self._folder = request, folder
        self._poses: NDArray[np.float64] | None = None

    def write(self, frame: Frame) -> None:
        """Write a frame in place of the last.

        Raises:
            InputError: a file cannot be written.
        """
        if self._poses is None:
            self._poses = frame.body_poses.astype(np.float64)
        for each in self._request.cached:
            path = self._folder / f"{LIVE}{each.file}"
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
