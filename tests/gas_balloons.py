"""Balloons that hold gas, and their states; and the wetted part of a mesh, as trimesh cuts it."""

from dataclasses import replace
from typing import Any

import numpy as np
import trimesh
import warp as wp
from meshes import fans, mesh_of

from balloon_warp import Balloon, Frame, Inflation, PolygonMesh, Simulator, Stiffness
from balloon_warp.mesh.topology import signed_volume

NO_SPRINGS = Stiffness(structural=0.0, shear=0.0, flexion=0.0)
AIR_PRESSURE, TEMPERATURE, GAS_CONSTANT = 101325.0, 293.15, 8.314462618
PRESSURE_ROUNDING = 0.1
"""[Pa]: a float32 volume is rounded by some 1e-7 of itself, and that moves the gas's 1e5 Pa so much"""


def isentropic(pressure: Any, density: Any, gamma: float = 1.4, outside: float = AIR_PRESSURE) -> tuple[Any, Any]:
    """Return the flow [kg/s/m^2] and thrust [Pa] of a nozzle under a gauge pressure [Pa], by the Mach number M there:
    m = p_t M root(gamma / (R T_t)), F = p_t (1 + gamma M^2) - p_air, with M at most 1 (Anderson, Modern Compressible
    Flow, chapter 5)."""
    behind = outside + pressure
    mach = np.minimum(np.sqrt(2.0 / (gamma - 1.0) * ((behind / outside) ** (1.0 - 1.0 / gamma) - 1.0)), 1.0)
    cooled = 1.0 + 0.5 * (gamma - 1.0) * mach**2
    throat = behind * cooled ** (-gamma / (gamma - 1.0))
    specific = behind / density / cooled  # R T of a kilogram
    return throat * mach * np.sqrt(gamma / specific), throat * (1.0 + gamma * mach**2) - outside


def octahedron(radius: float = 1.0) -> PolygonMesh:
    """Return an octahedron, whose vertices are all alike."""
    points = radius * np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])
    faces = [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]]
    return mesh_of(points, faces)


def jittered(mesh: PolygonMesh, by: float = 0.1) -> PolygonMesh:
    """Return a mesh with jittered points, so that its faces are not flat."""
    return replace(mesh, points=mesh.points + np.random.default_rng(0).uniform(-by, by, mesh.points.shape))


def with_volume(mesh: PolygonMesh, volume: float) -> PolygonMesh:
    return replace(mesh, points=mesh.points * np.cbrt(volume / signed_volume(mesh)))


def gas_balloon(mesh: PolygonMesh, gas: dict | None = None, **fields) -> Balloon:
    """Return a balloon of gas without springs, damping and added mass."""
    inflation = Inflation(kind="gas", **({"added_mass": 0.0} | (gas or {})))
    return Balloon(**{"mesh": mesh, "stiffness": NO_SPRINGS, "damping": 0.0, "inflation": inflation} | fields)


def volume_of(simulator: Simulator, frame: Frame, number: int = 0) -> float:
    mesh = simulator.model.shapes[number].mesh
    return signed_volume(replace(mesh, points=frame.points[number].astype(np.float64)))


def set_state(simulator: Simulator, **arrays: np.ndarray) -> None:
    """Set the state of one world."""
    for name, values in arrays.items():
        array = getattr(simulator.state, name)
        wp.copy(array, wp.array(np.asarray(values)[None], dtype=array.dtype, device=array.device))


def wet_part(mesh: PolygonMesh, level: float) -> trimesh.Trimesh:
    """Return the part below the level that trimesh cuts off, open at the cut."""
    solid = fans(mesh)
    points, triangles, _ = trimesh.intersections.slice_faces_plane(
        solid.vertices, solid.faces, plane_normal=np.array([0, -1, 0]), plane_origin=np.array([0, level, 0])
    )
    return trimesh.Trimesh(points, triangles, process=False)


def displaced(mesh: PolygonMesh, level: float) -> tuple[float, np.ndarray]:
    """Return the volume below the level, and its center: from a point on the surface the open cut has no volume."""
    wet = wet_part(mesh, level)
    wet.apply_translation([0.0, -level, 0.0])
    return wet.volume, wet.center_mass + [0.0, level, 0.0]
