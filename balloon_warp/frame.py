"""A frame on the host."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


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
