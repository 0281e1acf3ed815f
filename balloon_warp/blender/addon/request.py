"""Request of a bake: a snapshot of a Blender scene becomes a Balloon Warp scene, arrays, and point caches beside them.

Nothing here needs `bpy`: the process that bakes shares it. Values go into fields of the same meaning, converted to SI
units; which values are possible is checked where the request is read.
"""

import json
import os
import struct
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

FILES = ("request.json", "arrays.npz")
"""Files of a request"""
LIVE = "live_"
"""Begin of the names of a preview's caches"""
NEVER = 1e9
"""Frame of faces that do not tear"""
TABLES = {"BALLOON": "balloon", "BODY": "body", "OBSTACLE": "obstacle"}
"""Tables of a scene, by roles"""
MOLAR_MASSES = {"HELIUM": 0.0040026, "AIR": 0.0289652}
"""Molar masses of fillings [kg/mol]"""
SPRINGS_OF_SKIN = {"structural": 20.0, "shear": 10.0, "flexion": 5.0, "yield_stretch": 1.0, "viscosity": 1.0e-4}
"""Springs that only push, which keep the pieces of a burst balloon as skin [N/m]"""
RIGID = 1e-4
"""Largest growth of a rigid object, over its size"""
HEADER = struct.Struct("<12siiffi")
"""Signature, version, number of points, first frame, frames a sample, number of samples"""
SIGNATURE = b"POINTCACHE2\0"


class RefusedError(Exception):
    """A scene that cannot be baked; its sentence names the object."""


@dataclass
class Thing:
    """A mesh object that takes part, or an instance of one."""

    name: str
    settings: dict[str, Any]
    """Properties of its panel at the start, by their names"""
    points: NDArray[np.float64]
    """Points at the start in its own axes and units, shape (n, 3)"""
    counts: NDArray[np.int32]
    """Number of corners of each face"""
    corners: NDArray[np.int32]
    """Corners of all faces in order"""
    places: NDArray[np.float64]
    """Matrices from its own axes to the world's, one or one a frame, shape (1 or frames, 4, 4)"""
    pinned: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    """Points that only the animation moves: a balloon's pin group, or all of an obstacle that bends"""
    paths: NDArray[np.float64] = field(default_factory=lambda: np.zeros((1, 0, 3)))
    """Places of the pinned points in the world, shape (1 or frames, pinned, 3)"""
    amounts: list[float] = field(default_factory=list)
    """Volume, pressure [Pa] or litres that it is inflated to, of each frame; of the start alone where it stays"""
    anchors: NDArray[np.float64] | None = None
    """Places of the empty that its string is tied to, shape (1 or frames, 3)"""

    @property
    def role(self) -> str:
        """Role in the simulation: "BALLOON", "OBSTACLE" or "BODY"."""
        return self.settings["role"]

    @property
    def bends(self) -> bool:
        """Return whether the thing is an obstacle that moves point by point."""
        return self.role == "OBSTACLE" and len(self.pinned) > 0

    @property
    def bursts(self) -> bool:
        """Return whether the thing is a balloon that may burst: springs do not tear."""
        settings = self.settings
        return self.role == "BALLOON" and settings["burst"] != "NEVER" and settings["material"] != "SPRINGS"


@dataclass
class Snapshot:
    """A Blender scene, as far as a bake needs it."""

    things: list[Thing]
    """Objects that take part, balloons first"""
    first: int
    """Number that Blender gives the start"""
    frames: int
    """Number of frames after the start"""
    frames_per_second: float
    meters: float
    """Length of Blender's unit [m]"""
    gravities: NDArray[np.float64]
    """Downward acceleration, in Blender's units [1/s^2], shape (1 or frames,)"""
    settings: dict[str, Any]
    """Properties of the scene's panel, by their names"""
    winds: NDArray[np.float64] = field(default_factory=lambda: np.zeros((1, 3)))
    """Wind of all force fields [m/s], shape (1 or frames, 3)"""
    remarks: list[str] = field(default_factory=list)
    """Sentences on omissions of the bake"""


def is_rigid(places: NDArray[np.float64]) -> bool:
    """Return whether matrices of shape (n, 4, 4) differ by turns and shifts alone."""
    turns = np.array([place[:3, :3] @ np.linalg.pinv(places[0, :3, :3]) for place in places])
    return bool(np.abs(turns @ turns.transpose(0, 2, 1) - np.eye(3)).max() <= RIGID)


def in_world(points: NDArray[np.float64], place: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return points in the world, of an object with this matrix."""
    return points @ place[:3, :3].T + place[:3, 3]


def write_request(folder: Path, snapshot: Snapshot) -> list[str]:
    """Write a request into a folder, and return the name of each thing's cache, empty for a thing without one.

    Raises:
        RefusedError: things cannot be simulated together.
    """
    _require_contact(snapshot)
    tables: dict[str, list[dict[str, Any]]] = {}
    arrays: dict[str, Any] = {}
    listed, files = [], [_file(number, thing) for number, thing in enumerate(snapshot.things)]
    for number, (thing, file) in enumerate(zip(snapshot.things, files, strict=True)):
        table = "balloon" if thing.bends else TABLES[thing.role]
        within = tables.setdefault(table, [])
        place = {"table": table, "number": len(within), "arrays": str(number)}
        keyed = thing.role == "BALLOON" and len(thing.amounts) > 1 and thing.settings["inflate"] != "PRESSURE"
        listed.append({"name": thing.name, "file": file, "amounts": thing.amounts if keyed else []} | place)
        within.append(_table(thing, snapshot))
        arrays |= {
            f"{number}.points": start_points(thing, snapshot.meters),
            f"{number}.counts": thing.counts,
            f"{number}.corners": _outward(thing),
            f"{number}.places": thing.places,
            f"{number}.pinned": thing.pinned,
            f"{number}.paths": snapshot.meters * thing.paths,
        }
    scene = _surroundings(snapshot) | tables | _strings(snapshot)
    folder.mkdir(parents=True, exist_ok=True)
    told, numbers = (folder / name for name in FILES)
    with numbers.open("wb") as file:
        np.savez(file, **arrays)
    for thing, name in zip(snapshot.things, files, strict=True):
        if name and not samples_of(folder / name, len(thing.points)):  # else the last bake plays until the first frame
            PointCache(folder / name, len(thing.points)).write(0, thing.points.astype(np.float32))
    request = {"scene": scene, "things": listed, "meters": snapshot.meters}
    told.write_text(json.dumps(request), encoding="utf-8")
    return files


def tears_of(cache: Path) -> Path:
    """Return the path of the file beside a cache with the frames after the start in which faces tear, float32."""
    return cache.with_suffix(".torn")


def _require_contact(snapshot: Snapshot) -> None:
    """Require touch and rigid motion of objects that push balloons.

    Raises:
        RefusedError: an obstacle that bends has no contact, or a balloon that bursts would touch another thing.
    """
    skins = [thing for thing in snapshot.things if thing.role == "BALLOON" or thing.bends]
    bent = next((thing.name for thing in skins if thing.bends), None)
    bursting = next((thing.name for thing in skins if thing.bursts), None)
    if not snapshot.settings["touch"]:
        if bent:
            raise RefusedError(f"{bent}: bends, and pushes balloons as one of them; expected Touch")
    elif bursting and len(skins) > 1:
        what = f"{bent}, which bends," if bent else "other balloons"
        raise RefusedError(f"{bursting}: may burst, and cannot touch {what} then; expected Burst Never, or no Touch")


def start_points(thing: Thing, meters: float) -> NDArray[np.float64]:
    """Return the points at the start [m], along the world's axes; of a rigid obstacle from its own origin."""
    points = in_world(thing.points, thing.places[0])
    from_origin = thing.role == "OBSTACLE" and not thing.bends
    return meters * (points - thing.places[0, :3, 3] if from_origin else points)


def _file(number: int, thing: Thing) -> str:
    if thing.role == "OBSTACLE":
        return ""
    letters = "".join(letter if letter.isalnum() or letter in "-_" else "_" for letter in thing.name)
    return f"{number:03d}_{letters}.pc2"


def _outward(thing: Thing) -> NDArray[np.int32]:
    """Return the corners of the faces, in the other order where the object is mirrored."""
    if np.linalg.det(thing.places[0][:3, :3]) > 0.0:
        return thing.corners
    return np.concatenate([face[::-1] for face in np.split(thing.corners, np.cumsum(thing.counts)[:-1])])


def _surroundings(snapshot: Snapshot) -> dict[str, Any]:
    settings = snapshot.settings
    scene: dict[str, Any] = {
        "up_axis": "Z",
        "gravity": snapshot.gravities[0] * snapshot.meters,
        "frames": snapshot.frames,
        "frames_per_second": snapshot.frames_per_second,
    }
    if settings["ground"]:
        scene["ground"] = {"height": settings["ground_height"] * snapshot.meters}
    if not settings["touch"]:
        scene["touch"] = False
    elif settings["quality"] == "FINE" and not any(thing.bursts for thing in snapshot.things):
        scene |= {"touch": {"edges": True}, "faces": True}
    if np.any(snapshot.winds):
        scene["atmosphere"] = {"wind": snapshot.winds[0].tolist()}
    if changes := _changes(snapshot):
        scene["change"] = changes
    return scene


def _changes(snapshot: Snapshot) -> list[dict[str, Any]]:
    """Make the changes of gravity and wind, at the frames that have other ones than the last."""
    values = {"gravity": snapshot.gravities * snapshot.meters, "atmosphere.wind": snapshot.winds}
    changes = []
    for frame in range(1, max(len(of_frames) for of_frames in values.values())):
        said = {
            path: of_frames[frame].tolist()
            for path, of_frames in values.items()
            if len(of_frames) > 1 and np.any(of_frames[frame] != of_frames[frame - 1])
        }
        if said:
            changes.append({"time": frame / snapshot.frames_per_second, "set": said})
    return changes


def _table(thing: Thing, snapshot: Snapshot) -> dict[str, Any]:
    if thing.role == "OBSTACLE":
        return _bending(thing) if thing.bends else _obstacle(thing, snapshot)
    settings = thing.settings
    if thing.role == "BODY":
        return {"name": thing.name, "mass": settings["mass"], "friction": settings["friction"], "up": "Z"}
    balloon = {
        "name": thing.name,
        "up": "Z",
        "unit": "m",
        "helium": 0.0 if settings["inflate"] == "LITRES" else settings["lift"],
        "damping": settings["damping"],
        "drag_coefficient": settings["drag"] if np.any(snapshot.winds) else 0.0,
        "friction": settings["friction"],
        "fixed": thing.pinned.tolist(),
        "inflation": _inflation(thing, snapshot.frames_per_second),
    }
    if thing.bursts:
        material = {"strength": 1e6 * settings["strength"], "springs": ["structural", "shear", "flexion"]}
        if settings["burst"] == "NEEDLE":
            material["needle_time"] = max(settings["burst_frame"] - snapshot.first, 0) / snapshot.frames_per_second
        balloon["stiffness"] = SPRINGS_OF_SKIN
        return balloon | {"material": material | {"preset": settings["material"].lower()}}
    if settings["material"] != "SPRINGS":
        return balloon | {"material": {"preset": settings["material"].lower()}}
    constant = settings["stiffness"]
    constants = {"structural": constant, "shear": 0.5 * constant, "flexion": 0.2 * constant}
    return balloon | {"mass": settings["mass"], "stiffness": constants | {"even": True, "thin": "tied"}}


def _bending(thing: Thing) -> dict[str, Any]:
    """Make the table of an obstacle that bends: a balloon all of whose points are pinned."""
    return {
        "name": thing.name,
        "up": "Z",
        "unit": "m",
        "friction": thing.settings["friction"],
        "fixed": thing.pinned.tolist(),
        "inflation": {"pressure": 0.0},
        "holes": "keep",
    }


def _inflation(thing: Thing, frames_per_second: float) -> dict[str, Any]:
    settings = thing.settings
    first, stays = thing.amounts[0], len(thing.amounts) == 1
    if settings["inflate"] == "VOLUME":
        return {"stretch": first ** (1.0 / 3.0) - 1.0}
    if settings["inflate"] == "PRESSURE":
        keyed = [[frame / frames_per_second, pressure] for frame, pressure in enumerate(thing.amounts)]
        return {"pressure": first if stays else keyed}
    gas = {"kind": "gas", "fill_time": settings["fill_time"], "molar_mass": MOLAR_MASSES[settings["filling"]]}
    return gas | ({"litres": first} if stays else {})


def _obstacle(thing: Thing, snapshot: Snapshot) -> dict[str, Any]:
    """Make the table of an obstacle, which may move and turn."""
    meters, first = snapshot.meters, thing.places[0]
    table = {
        "name": thing.name,
        "up": "Z",
        "unit": "m",
        "position": (meters * first[:3, 3]).tolist(),
        "friction": thing.settings["friction"],
    }
    if len(thing.places) == 1:
        return table
    turns = np.array([place[:3, :3] @ np.linalg.inv(first[:3, :3]) for place in thing.places])
    shifts = meters * (thing.places[:, :3, 3] - first[:3, 3])
    keys = zip(shifts.tolist(), turn_angles(turns).tolist(), strict=True)
    return table | {"motion": [[frame / snapshot.frames_per_second, *key] for frame, key in enumerate(keys)]}


def turn_angles(turns: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return rotations as angles about x, then y, then z [degrees], without jumps, shape (n, 3).

    Args:
        turns: Rotation matrices, shape (n, 3, 3).
    """
    x = np.arctan2(turns[:, 2, 1], turns[:, 2, 2])
    y = np.arcsin(np.clip(-turns[:, 2, 0], -1.0, 1.0))
    z = np.arctan2(turns[:, 1, 0], turns[:, 0, 0])
    angles = np.stack([x, y, z], axis=1)
    for frame in range(1, len(angles)):  # of the two that mean the same, and all whole turns, the nearest
        a, b, c = angles[frame]
        both = np.array([[a, b, c], [a + np.pi, np.pi - b, c + np.pi]])
        both += 2.0 * np.pi * np.round((angles[frame - 1] - both) / (2.0 * np.pi))
        angles[frame] = both[np.abs(both - angles[frame - 1]).sum(axis=1).argmin()]
    return np.degrees(angles)


def _strings(snapshot: Snapshot) -> dict[str, Any]:
    """Make the strings of balloons: each holds the point that is nearest to its empty at the start."""
    strings, meters = [], snapshot.meters
    balloons = [thing for thing in snapshot.things if thing.role == "BALLOON"]
    for number, thing in enumerate(balloons):
        if thing.anchors is None:
            continue
        anchors = meters * thing.anchors
        nearest = np.linalg.norm(start_points(thing, meters) - anchors[0], axis=1).argmin()
        string: dict[str, Any] = {"anchor": anchors[0].tolist(), "balloon": number, "particle": int(nearest)}
        if len(anchors) > 1:
            shifts = (anchors - anchors[0]).tolist()
            string["motion"] = [[frame / snapshot.frames_per_second, shift] for frame, shift in enumerate(shifts)]
        strings.append(string)
    return {"string": strings} if strings else {}


class PointCache:
    """Points of one object, a sample a frame.

    A sample counts once all of it is in the file, so that a reader sees whole frames, also after a kill.

    Args:
        path: of the file; one that has this number of points goes on growing, anything else is replaced.
        point_count: Number of points in a sample.

    Raises:
        OSError: the file cannot be written.
    """

    def __init__(self, path: Path, point_count: int):
        self.path, self.point_count = path, point_count
        self.sample_count = samples_of(path, point_count)
        self._file = path.open("r+b" if self.sample_count else "w+b")
        if not self.sample_count:
            self._write_header()

    def write(self, number: int, points: NDArray[np.float32]) -> None:
        """Write a sample; those after it count no more.

        Args:
            number: of the sample, at most that of all before it.
            points: shape (point_count, 3), in the object's own axes and units.

        Raises:
            OSError: the file cannot be written.
        """
        sample = np.ascontiguousarray(points, dtype="<f4")
        if sample.shape != (self.point_count, 3) or number > self.sample_count:
            raise ValueError(f"{self.path}: sample {number} of {sample.shape} after {self.sample_count}")
        self._file.seek(HEADER.size + number * sample.nbytes)
        self._file.write(sample.tobytes())
        self._file.flush()
        self.sample_count = number + 1
        self._write_header()

    def sync(self) -> None:
        """Wait until all samples are safe on the disk."""
        os.fsync(self._file.fileno())

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _write_header(self) -> None:
        self._file.seek(0)
        self._file.write(HEADER.pack(SIGNATURE, 1, self.point_count, 0.0, 1.0, self.sample_count))
        self._file.flush()


def samples_of(path: Path, point_count: int) -> int:
    """Return the number of samples of a cache with so many points; 0 where the file is another or none."""
    try:
        with path.open("rb") as file:
            header = file.read(HEADER.size)
    except FileNotFoundError:
        return 0
    if len(header) < HEADER.size or HEADER.unpack(header)[:3] != (SIGNATURE, 1, point_count):
        return 0
    return HEADER.unpack(header)[5]
