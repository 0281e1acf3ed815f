"""A frame on the host."""

from dataclasses import dataclass

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.kernels.laws.law import FAR
from balloon_warp.model import Model, State
from balloon_warp.schedules.readout import ForceReader


@dataclass(frozen=True)
class Frame:
    """One world as it is displayed or written, on the host."""

    number: int
    points: list[NDArray[np.float32]]
    """of each balloon [m], shape (particle_count, 3)"""
    velocities: list[NDArray[np.float32]]
    """of each balloon [m/s], shape (particle_count, 3)"""
    net_forces: list[NDArray[np.float32]]
    """on each balloon's particles [N], shape (particle_count, 3); empty unless the scene asks for them"""
    inflation_forces: list[NDArray[np.float32]]
    """on each balloon's particles [N], shape (particle_count, 3)"""
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
        self._forces = ForceReader(model)

    def read(self, state: State, number: int, world: int, net_forces: bool) -> Frame:
        """One world of a state at the frame of that number, with the net forces if they are wanted."""
        anchors = self.model.parameters["string_anchor"]
        self._forces.refresh(state)
        inflation_forces = self._of_balloons(self._forces.inflation_forces(state), world)
        return Frame(
            number=number,
            points=self._moving_along(state.points, world),
            velocities=self._moving_along(state.velocities, world),
            net_forces=self._of_balloons(self._forces.net_forces(state), world) if net_forces else [],
            inflation_forces=inflation_forces,
            pressures=state.pressures.numpy()[world].copy(),
            gas_amounts=state.gas_amounts.numpy()[world].copy(),
            sphere_positions=_copy(state.sphere_positions, world),
            sphere_velocities=_copy(state.sphere_velocities, world),
            string_anchors=_copy(anchors, world % anchors.shape[0]),
            ground_height=_height(self.model.parameters["ground_height"], world),
            water_level=_height(self.model.parameters["water_level"], world),
        )

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
