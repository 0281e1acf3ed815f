"""Request of a bake, as the add-on writes it: a scene with meshes in memory, and the objects that are to be cached."""

import json
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from balloon_warp.blender.addon.request import FILES
from balloon_warp.blender.keyed import with_keyframes
from balloon_warp.errors import InputError
from balloon_warp.mesh import PolygonMesh
from balloon_warp.scene import Scene


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
