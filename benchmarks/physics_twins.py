"""Twins of a scene: turned, mirrored, moved, scaled, listed in another order, or nudged; and the way back from them."""

import re
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel
from scipy.spatial.transform import Rotation

from balloon_warp.benchmarks.physics_meshes import listed
from balloon_warp.mesh import PolygonMesh
from balloon_warp.scene import Scene
from balloon_warp.scene.fields import meaning_of

Tables = dict[str, Any]
Array = NDArray[np.float64]
VECTORS = ("position", "velocity", "anchor", "newtons", "wind")
AXIAL = ("angular_velocity",)


@dataclass(frozen=True)
class Twin:
    """Twin of a scene in another guise, and the way back: points' = scale * matrix @ points[order] + shift."""

    tables: Tables
    matrix: Array = field(default_factory=lambda: np.eye(3))
    shift: Array = field(default_factory=lambda: np.zeros(3))
    scale: float = 1.0
    order: NDArray[np.int64] | None = None
    """Numbers of the things in the scene, in the twin's order"""

    def back(self, points: Array) -> Array:
        """Return points of the twin as the scene has them, shape (..., n, 3)."""
        places = (points - self.shift) @ self.matrix / self.scale
        if self.order is None:
            return places
        there = np.empty_like(places)
        there[..., self.order, :] = places
        return there


def nudged(tables: Tables, distance: float, seed: int) -> Twin:
    """Displace each particle by a distance [m]."""
    random = np.random.default_rng(seed)
    for balloon in tables["balloon"]:
        mesh = balloon["mesh"]
        noise = random.normal(size=mesh.points.shape)
        noise *= distance / balloon["scale"] / np.linalg.norm(noise, axis=1, keepdims=True)
        balloon["mesh"] = with_points(mesh, mesh.points + noise)
    return Twin(tables)


def turned(tables: Tables, matrix: Array, shift: Array | None = None) -> Twin:
    """Turn or mirror a scene by an orthogonal matrix that keeps the up axis, or takes Y to Z; and move it."""
    shift = np.zeros(3) if shift is None else shift
    up = "Z" if matrix[2, 1] > 0.5 else "Y"
    parity = round(float(np.linalg.det(matrix)))
    axes = np.roll(np.eye(3), 1, axis=0) if up == "Z" else np.diag((parity, 1, 1))  # of boxes and capsules, exactly

    def turn(table: Tables) -> None:
        for name in (*VECTORS, *AXIAL):
            if name in table:
                sign = parity if name in AXIAL else 1
                moved = shift if name in ("position", "anchor") else 0.0
                table[name] = tuple((sign * matrix @ np.array(table[name]) + moved).tolist())

    for balloon in tables["balloon"]:
        points = placed(balloon)
        corners = balloon["mesh"].face_vertex_indices
        mesh = listed(points @ matrix.T + shift, balloon["mesh"].face_vertex_counts, corners, up)
        balloon["mesh"] = mesh if parity > 0 else wound_back(mesh)
        turn(balloon)
        balloon |= {"position": (0.0, 0.0, 0.0), "rotation": (0.0, 0.0, 0.0), "scale": 1.0}
    for name in ("sphere", "string", "force", "body", "obstacle"):
        for thing in tables.get(name, []):
            turn(thing)
            if "size" in thing:
                thing["size"] = tuple((np.abs(axes) @ np.array(thing["size"])).tolist())
            if name in ("body", "obstacle"):
                own = matrix @ rotation_of(thing["rotation"]).as_matrix() @ axes.T
                thing["rotation"] = tuple(Rotation.from_matrix(own).as_euler("xyz", degrees=True).tolist())
            if "motion" in thing:  # turns about the up axis alone
                thing["motion"] = [
                    [time, tuple((matrix @ np.array(by)).tolist())]
                    + [tuple((parity * matrix @ np.array(each)).tolist()) for each in turns]
                    for time, by, *turns in thing["motion"]
                ]
    turn(tables["atmosphere"])
    height = float((matrix @ shift)[1]) if up == "Y" else 0.0
    assert height == 0.0, "the ground and the water stay where they are"
    return Twin({**tables, "up_axis": up}, matrix, shift)


def relisted(tables: Tables, seed: int = 3) -> Twin:
    """List vertices, faces and balloons in another order."""
    random = np.random.default_rng(seed)
    orders, balloons, start = [], [], 0
    for balloon in tables["balloon"]:
        mesh = balloon["mesh"]
        order = random.permutation(mesh.vertex_count)
        numbers = np.argsort(order)
        starts = np.cumsum(mesh.face_vertex_counts) - mesh.face_vertex_counts
        faces = random.permutation(mesh.face_count)
        rows = [mesh.face_vertex_indices[starts[f] : starts[f] + mesh.face_vertex_counts[f]] for f in faces]
        corners = numbers[np.concatenate(rows)]
        balloons.append({**balloon, "mesh": listed(mesh.points[order], mesh.face_vertex_counts[faces], corners)})
        orders.append(start + order)
        start += mesh.vertex_count
        for string in tables.get("string", []):
            if string["balloon"] == len(orders) - 1:
                string["particle"] = int(numbers[string["particle"]])
    for string in tables.get("string", []):
        string["balloon"] = len(orders) - 1 - string["balloon"]
    for tube in tables.get("tube", []):
        tube["balloons"] = tuple(len(orders) - 1 - number for number in tube["balloons"])
    others = start + np.arange(len(tables.get("sphere", [])) + len(tables.get("body", [])))
    return Twin({**tables, "balloon": balloons[::-1]}, order=np.concatenate([*orders[::-1], others]))


def scaled(tables: Tables, length: float, mass: float, time: float) -> Twin:
    """Scale lengths, masses and times; each field by the unit in its description."""
    scene = Scene.model_validate(tables)
    return Twin(_scaled(scene, (length, mass, time)), scale=length)


UNITS = {"m": (1, 0, 0), "kg": (0, 1, 0), "s": (0, 0, 1), "N": (1, 1, -2), "Pa": (-1, 1, -2), "J": (2, 1, -2)}
UNITS |= {"mol": (2, 1, -2), "l": (3, 0, 0)} | dict.fromkeys(("1", "K", "rad", "degrees"), (0, 0, 0))
"""Exponents of length, mass and time; a mole is n = p V / (R T) at the same temperature"""


def dimension(text: str) -> Array | None:
    """Return the exponents of the last unit in a field's description, such as [kg/m^3], shape (3,)."""
    found = re.findall(r"\[([a-zA-Z0-9 ()/^]+)\]", text)
    if not found:
        return None
    above, _, below = found[-1].partition("/")
    total = np.zeros(3)
    for sign, part in ((1, above), (-1, below.strip("()"))):
        for factor in part.split():
            name, _, power = factor.partition("^")
            total += sign * np.array(UNITS[name]) * int(power or 1)
    return total


def _scaled(table: BaseModel, units: tuple[float, float, float]) -> Tables:
    found: Tables = {}
    for name in table.model_fields_set:
        value, exponents = getattr(table, name), dimension(meaning_of(type(table), name))
        factor = 1.0 if exponents is None else float(np.prod(np.array(units) ** exponents))
        if name in ("motion", "pressure", "pump") and isinstance(value, list):  # keyframes: times and values
            value = [
                [row[0] * units[2], _times(row[1], units[0] if name == "motion" else factor), *row[2:]] for row in value
            ]
        elif name == "set":
            value = {path: each * units[0] / units[2] ** 2 for path, each in value.items()}  # gravity alone
        elif isinstance(value, BaseModel):
            value = _scaled(value, units)
        elif isinstance(value, list) and value and isinstance(value[0], BaseModel):
            value = [_scaled(each, units) for each in value]
        elif isinstance(value, PolygonMesh):
            value = with_points(value, value.points)
        elif factor != 1.0:
            value = _times(value, factor)
        found[name] = value
    if "mesh" in found and "scale" in found:
        found["scale"] *= units[0]
    return found


def _times(value: Any, factor: float) -> Any:
    if isinstance(value, tuple | list):
        return tuple(_times(each, factor) for each in value)
    return value * factor if isinstance(value, float | int) and not isinstance(value, bool) else value


def placed(balloon: Tables) -> Array:
    """Return the places of a balloon's particles at the start [m], shape (n, 3)."""
    return rotation_of(balloon["rotation"]).apply(balloon["mesh"].points * balloon["scale"]) + balloon["position"]


def rotation_of(degrees: tuple[float, float, float]) -> Rotation:
    """Return the rotation about x, then y, then z."""
    return Rotation.from_euler("xyz", degrees, degrees=True)


def with_points(mesh: PolygonMesh, points: Array) -> PolygonMesh:
    """Return a mesh with its vertices elsewhere."""
    return listed(points, mesh.face_vertex_counts, mesh.face_vertex_indices, mesh.up_axis)


def wound_back(mesh: PolygonMesh) -> PolygonMesh:
    """Return a mesh whose faces list their corners backwards."""
    parts = np.split(mesh.face_vertex_indices, np.cumsum(mesh.face_vertex_counts)[:-1])
    return listed(mesh.points, mesh.face_vertex_counts, np.concatenate([part[::-1] for part in parts]), mesh.up_axis)
