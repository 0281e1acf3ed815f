"""A frame on the host."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.kernels.laws.law import FAR
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.geometry import volume_and_area
from balloon_warp.model import Model, State


@dataclass(frozen=True, repr=False)
class Frame:
    """One world as it is displayed or written, on the host."""

    number: int
    """how many came before it"""
    time: float
    """since the start [s]"""
    points: list[NDArray[np.float32]]
    """of each balloon [m], shape (particle_count, 3)"""
    velocities: list[NDArray[np.float32]]
    """of each balloon [m/s], shape (particle_count, 3)"""
    net_forces: list[NDArray[np.float32]]
    """on each balloon's particles [N], shape (particle_count, 3); empty unless the scene asks for them"""
    inflation_forces: list[NDArray[np.float32]]
    """those of the inflation alone; also where a balloon is inflated by normal forces, whose pressure they tell"""
    pressures: NDArray[np.float32]
    """of balloons with pressure or gas, above the air's [Pa], 0 for others, shape (balloon_count,)"""
    gas_amounts: NDArray[np.float64]
    """in each balloon [mol], shape (balloon_count,)"""
    sphere_positions: NDArray[np.float32]
    """[m], shape (sphere_count, 3)"""
    sphere_velocities: NDArray[np.float32]
    """[m/s], shape (sphere_count, 3)"""
    string_anchors: NDArray[np.float32]
    """[m], shape (string_count, 3)"""
    ground_height: float
    """[m], minus infinity where there is no ground"""
    water_level: float
    """[m], minus infinity where there is no water"""
    meshes: list[PolygonMesh]
    """of the balloons, as they are at the start"""

    @property
    def volumes(self) -> NDArray[np.float64]:
        """of the balloons [m^3], shape (balloon_count,): what a closed one encloses"""
        return self._volumes_and_areas[:, 0]

    @property
    def areas(self) -> NDArray[np.float64]:
        """of the balloons [m^2], shape (balloon_count,)"""
        return self._volumes_and_areas[:, 1]

    @cached_property
    def _volumes_and_areas(self) -> NDArray[np.float64]:
        pairs = zip(self.meshes, self.points, strict=True)
        now = (replace(mesh, points=points.astype(np.float64)) for mesh, points in pairs)
        return np.array([volume_and_area(mesh) for mesh in now]).reshape(-1, 2)

    def __repr__(self) -> str:
        balloons = ", ".join(
            f"{mesh.name} of {mesh.vertex_count} particles and {volume:.3g} m^3"
            for mesh, volume in zip(self.meshes, self.volumes, strict=True)
        )
        return f"Frame({self.number}, {self.time:.3f} s: {balloons})"

    @property
    def is_finite(self) -> bool:
        """Whether all that is written of it is."""
        lists = (self.points, self.velocities, self.net_forces, self.inflation_forces)
        arrays = (self.pressures, self.gas_amounts, self.sphere_positions, self.sphere_velocities)
        return all(np.isfinite(array).all() for array in (*(array for each in lists for array in each), *arrays))


class FrameReader:
    """Copies worlds of a model to the host, one at a time."""

    def __init__(self, model: Model):
        self.model = model

    @cached_property
    def _forces(self) -> Any:
        from balloon_warp.schedules.readout import ForceReader  # loads, and compiles kernels, when first needed

        return ForceReader(self.model)

    def read(self, state: State, number: int, world: int, net_forces: bool) -> Frame:
        """One world of a state at the frame of that number, with forces if they are wanted."""
        anchors = self.model.parameters["string_anchor"]
        of_all, of_inflation = self._read_forces(state, world, net_forces)
        return Frame(
            number=number,
            time=number * self.model.frame_seconds,
            points=self._moving_along(state.points, world),
            velocities=self._moving_along(state.velocities, world),
            net_forces=of_all,
            inflation_forces=of_inflation,
            pressures=state.pressures.numpy()[world].copy(),
            gas_amounts=state.gas_amounts.numpy()[world].copy(),
            sphere_positions=_copy(state.sphere_positions, world),
            sphere_velocities=_copy(state.sphere_velocities, world),
            string_anchors=_copy(anchors, world % anchors.shape[0]),
            ground_height=_height(self.model.parameters["ground_height"], world),
            water_level=_height(self.model.parameters["water_level"], world),
            meshes=[shape.mesh for shape in self.model.shapes],
        )

    def _read_forces(
        self, state: State, world: int, net_forces: bool
    ) -> tuple[list[NDArray[np.float32]], list[NDArray[np.float32]]]:
        """The net forces, and the inflation's: of each what is wanted."""
        by_normals = any(balloon.inflation.kind == "normal_force" for balloon in self.model.scene.balloon)
        if not net_forces and not by_normals:
            return [], []
        self._forces.refresh(state)
        of_all = self._of_balloons(self._forces.net_forces(state), world) if net_forces else []
        return of_all, self._of_balloons(self._forces.inflation_forces(state), world)

    def _of_balloons(self, array: wp.array, world: int) -> list[NDArray[np.float32]]:
        """One world's rows of a particle array, split by balloon."""
        return np.split(_copy(array, world), self.model.particle_offsets[1:-1])

    def _moving_along(self, array: wp.array, world: int) -> list[NDArray[np.float32]]:
        """The same, welded vertices with the rows of those that stand in for them."""
        stand_ins = (shape.mesh.stand_ins for shape in self.model.shapes)
        rows = self._of_balloons(array, world)
        return [own if others is None else own[others] for own, others in zip(rows, stand_ins, strict=True)]


def _copy(array: wp.array, world: int) -> NDArray[np.float32]:
    """One world's row on the host; on the CPU `numpy()` alone is a view of what goes on changing."""
    row = array[world].numpy() if array.shape[1] else np.zeros((0, 3))  # Warp does not slice an empty array
    return np.array(row, dtype=np.float32)


def _height(parameter: wp.array, world: int) -> float:
    """One world's height of a surface [m], of a parameter of shape (W,); minus infinity where there is none."""
    height = float(parameter.numpy()[world % parameter.shape[0]])
    return height if height > -FAR else -np.inf
