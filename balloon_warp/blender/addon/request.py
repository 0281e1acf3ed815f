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
from .snapshot import RefusedError, Snapshot, Thing, in_world

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
    """Make sure that what pushes balloons can.

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
