"""A frame on the host, and its contact forces."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.topology import corners_beside, total_area, volume_and_area
from balloon_warp.model import Model, ModelPlan
from balloon_warp.system.api import Shown, described

PAIR_ARRAYS = ("forces", "torques", "areas", "pressures", "places")
"""Arrays of `State` for each pair, named after `contact_`"""


@described
@dataclass(frozen=True, repr=False)
class Contact(Shown):
    """Contact of a balloon with another thing, averaged over a frame."""

    balloon: str
    """Name of the balloon"""
    other: str
    """Name of the other thing: an obstacle, a body or a balloon; "ground", or "sphere 0" """
    force: NDArray[np.float64]
    """Force on the balloon [N], shape (3,); the other thing has the opposite"""
    torque: NDArray[np.float64]
    """Torque on the balloon about the mean of its points [N m], shape (3,)"""
    area: float
    """Contact area of the balloon [m^2]"""
    pressure: float
    """Largest pressure at a particle, its force over its share of the area; between two balloons, summed over both
    [Pa]"""
    place: NDArray[np.float64]
    """Center of pressure, the mean of the pressed places weighted by force [m], shape (3,)"""
    number: int
    """Index of the balloon in the scene"""
    thing: int
    """Index of the other thing among `things_of` the model"""

    def __repr__(self) -> str:
        force = ", ".join(f"{number:.3g}" for number in self.force)
        return f"Contact({self.other} on {self.balloon}: ({force}) N on {self.area:.3g} m^2)"


def things_of(model: Model | ModelPlan) -> list[str]:
    """Name all that balloons may touch, in the order in which kernels number it: see `kernels.loops.fixtures`."""
    scene = model.scene
    kinds = (("obstacle", scene.obstacle), ("body", scene.body))
    named = {kind: [each.name or f"{kind} {number}" for number, each in enumerate(things)] for kind, things in kinds}
    spheres = [f"sphere {number}" for number in range(len(scene.sphere))]
    return ["ground", *named["obstacle"], *spheres, *named["body"], *(shape.name for shape in model.shapes)]


def contacts_of(model: Model, told: Mapping[str, NDArray[np.float64]]) -> list[Contact]:
    """List the pairs that touched in a frame.

    Args:
        told: a world's `PAIR_ARRAYS`, by name.
    """
    things = things_of(model)
    return [
        Contact(
            balloon=model.shapes[number].name,
            other=things[thing],
            force=told["forces"][number, thing],
            torque=told["torques"][number, thing],
            area=float(told["areas"][number, thing]),
            pressure=float(told["pressures"][number, thing]),
            place=told["places"][number, thing],
            number=number,
            thing=thing,
        )
        for number, thing in np.argwhere(told["areas"] > 0.0).tolist()
    ]


@described
@dataclass(frozen=True, repr=False)
class Frame(Shown):
    """Frame of a world, on the host, as it is displayed or written."""

    number: int
    """Number of frames before it"""
    time: float
    """Time since the start [s]"""
    points: list[NDArray[np.float32]]
    """Positions of each balloon's particles [m], shape (particle_count, 3)"""
    velocities: list[NDArray[np.float32]]
    """Velocities of each balloon's particles [m/s], shape (particle_count, 3)"""
    net_forces: list[NDArray[np.float32]]
    """Net forces on each balloon's particles [N], shape (particle_count, 3); empty unless the scene asks for them"""
    inflation_forces: list[NDArray[np.float32]]
    """Inflation's part of `net_forces`; also without asking, where a balloon has the paper's inflation"""
    pressures: NDArray[np.float32]
    """Gauge pressures of balloons with pressure or gas [Pa], 0 for others, shape (balloon_count,)"""
    gas_amounts: NDArray[np.float64]
    """Amount of gas in each balloon [mol], shape (balloon_count,)"""
    thrusts: NDArray[np.float32]
    """Thrust of the jet of each balloon's neck [N], shape (balloon_count,)"""
    sphere_positions: NDArray[np.float32]
    """Positions of spheres [m], shape (sphere_count, 3)"""
    sphere_velocities: NDArray[np.float32]
    """Velocities of spheres [m/s], shape (sphere_count, 3)"""
    string_anchors: NDArray[np.float32]
    """Anchors of strings [m], shape (string_count, 3)"""
    string_lengths: NDArray[np.float32]
    """Lengths of strings [m], shape (string_count,)"""
    obstacle_poses: NDArray[np.float64]
    """Origins [m] and orientations of obstacles as quaternions (x, y, z, w), shape (obstacle_count, 7)"""
    body_poses: NDArray[np.float32]
    """Centers of mass [m] and orientations of bodies as quaternions (x, y, z, w), shape (body_count, 7)"""
    ground_height: float
    """Height of the ground [m], minus infinity where there is no ground"""
    water_level: float
    """Level of the water [m], minus infinity where there is no water"""
    meshes: list[PolygonMesh]
    """Meshes of the balloons at the start"""
    torn: list[NDArray[np.bool_]]
    """Mask of the torn faces of each balloon, shape (face_count,); empty where no balloon may burst"""
    contacts: list[Contact]
    """Contacts of balloons, averaged over the frame; empty unless the scene has `contacts`"""

    @property
    def volumes(self) -> NDArray[np.float64]:
        """Volume of each balloon [m^3], shape (balloon_count,).

        It is the enclosed volume of a closed one; 0 of one that burst, once it is open.
        """
        return self._volumes_and_areas[:, 0]

    @property
    def areas(self) -> NDArray[np.float64]:
        """Area of each balloon [m^2], shape (balloon_count,)."""
        return self._volumes_and_areas[:, 1]

    @property
    def stretches(self) -> NDArray[np.float64]:
        """Mean stretch of each balloon, shape (balloon_count,): the root of the area over that at the start."""
        areas = np.array([total_area(mesh) for mesh in self.meshes])
        return np.sqrt(self.areas / np.maximum(areas, np.finfo(float).tiny))

    @cached_property
    def _volumes_and_areas(self) -> NDArray[np.float64]:
        pairs = zip(self.meshes, self.points, strict=True)
        closed = [replace(mesh, points=points.astype(np.float64)) for mesh, points in pairs]
        measures = np.array([volume_and_area(mesh) for mesh in closed]).reshape(-1, 2)
        for number, torn in enumerate(self.torn):
            if torn.any():
                left = replace(closed[number], face_vertex_indices=self.corners(number))
                measures[number] = measures[number, 0] * (self.gas_amounts[number] > 0.0), volume_and_area(left)[1]
        return measures

    def corners(self, number: int) -> NDArray[np.int32]:
        """Find the vertices at the corners of a balloon's faces, one face after the other.

        A torn face has all of its corners at one vertex, and so no area.

        Returns:
            shape (corner_count,)
        """
        mesh = self.meshes[number]
        if not self.torn or not self.torn[number].any():
            return mesh.face_vertex_indices
        return corners_beside(mesh, self.torn[number])

    def __repr__(self) -> str:
        balloons = ", ".join(
            f"{mesh.name} of {mesh.vertex_count} particles and {volume:.3g} m^3"
            for mesh, volume in zip(self.meshes, self.volumes, strict=True)
        )
        return f"Frame({self.number}, {self.time:.3f} s: {balloons})"

    @property
    def is_finite(self) -> bool:
        """Return whether all numbers that are written of it are finite."""
        lists = (self.points, self.velocities, self.net_forces, self.inflation_forces)
        arrays = (self.pressures, self.gas_amounts, self.thrusts)
        arrays += (self.sphere_positions, self.sphere_velocities, self.body_poses)
        return all(np.isfinite(array).all() for array in (*(array for each in lists for array in each), *arrays))
