"""Request of a bake: a Balloon Warp scene as its tables say it, and arrays beside it.

Values go into fields of the same meaning, converted to SI units; which values are possible is checked where the request
is read.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .point_cache import PointCache, samples_of
from .snapshot import RefusedError, Snapshot, Thing

FILES = ("request.json", "arrays.npz")
"""Files of a request"""
LIVE = "live_"
"""Begin of the names of a preview's caches"""
TABLES = {"BALLOON": "balloon", "BODY": "body", "OBSTACLE": "obstacle"}
"""Tables of a scene, by roles"""
MOLAR_MASSES = {"HELIUM": 0.0040026, "AIR": 0.0289652}
"""Molar masses of fillings [kg/mol]"""
RIGID = 1e-4
"""Largest growth of what counts as rigid, over its size"""


def write_request(folder: Path, snapshot: Snapshot) -> list[str]:
    """Write a request into a folder, and return the name of each thing's cache, empty for a thing without one.

    Raises:
        RefusedError: a thing cannot be simulated.
    """
    tables: dict[str, list[dict[str, Any]]] = {}
    arrays: dict[str, Any] = {}
    listed, files = [], [_file(number, thing) for number, thing in enumerate(snapshot.things)]
    for number, (thing, file) in enumerate(zip(snapshot.things, files, strict=True)):
        within = tables.setdefault(TABLES[thing.role], [])
        place = {"table": TABLES[thing.role], "number": len(within), "arrays": str(number)}
        keyed = len(thing.amounts) > 1 and thing.settings["inflate"] != "PRESSURE"  # which has keyframes itself
        listed.append({"name": thing.name, "file": file, "amounts": thing.amounts if keyed else []} | place)
        within.append(_table(thing, snapshot))
        arrays |= {
            f"{number}.points": start_points(thing, snapshot.meters),
            f"{number}.counts": thing.counts,
            f"{number}.corners": _outward(thing),
            f"{number}.places": thing.places,
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


def start_points(thing: Thing, meters: float) -> NDArray[np.float64]:
    """Return the points at the start [m], along the world's axes; of an obstacle from its own origin."""
    place = thing.places[0]
    turned = thing.points @ place[:3, :3].T
    return meters * (turned if thing.role == "OBSTACLE" else turned + place[:3, 3])


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
    settings, winds = snapshot.settings, snapshot.winds
    scene: dict[str, Any] = {
        "up_axis": "Z",
        "gravity": snapshot.gravity * snapshot.meters,
        "frames": snapshot.frames,
        "frames_per_second": snapshot.frames_per_second,
    }
    if settings["ground"]:
        scene["ground"] = {"height": settings["ground_height"] * snapshot.meters}
    if not settings["touch"]:
        scene["touch"] = False
    elif settings["quality"] == "FINE":
        scene |= {"touch": {"edges": True}, "faces": True}
    if np.any(winds):
        scene["atmosphere"] = {"wind": winds[0].tolist()}
        scene["change"] = [
            {"time": frame / snapshot.frames_per_second, "set": {"atmosphere.wind": winds[frame].tolist()}}
            for frame in range(1, len(winds))
            if np.any(winds[frame] != winds[frame - 1])
        ]
    return scene


def _table(thing: Thing, snapshot: Snapshot) -> dict[str, Any]:
    if thing.role == "OBSTACLE":
        return _obstacle(thing, snapshot)
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
    if settings["material"] != "SPRINGS":
        return balloon | {"material": {"preset": settings["material"].lower()}}
    constant = settings["stiffness"]
    constants = {"structural": constant, "shear": 0.5 * constant, "flexion": 0.2 * constant}
    return balloon | {"mass": settings["mass"], "stiffness": constants | {"even": True, "thin": "tied"}}


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
    if np.abs(turns @ turns.transpose(0, 2, 1) - np.eye(3)).max() > RIGID:
        raise RefusedError(f"{thing.name}: its scale changes; expected an obstacle that keeps its size")
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
