"""Values that count at the start alone, and can be drawn for each episode."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from balloon_warp.errors import InputError
from balloon_warp.kernels.frames.starting import shift_balloon
from balloon_warp.launching import launch
from balloon_warp.model import Model, State
from balloon_warp.model.parameters import places_of
from balloon_warp.model.rows import START, rows_of
from balloon_warp.steering.views import columns_of

IN_PARAMETERS = {"initial_velocities": "initial_velocities", "initial_spins": "initial_spins"}
"""Arrays of parameters that particles are placed by, by the names of their rows"""
IN_STATE = {
    "initial_sphere_positions": "sphere_positions",
    "initial_sphere_velocities": "sphere_velocities",
    "initial_sphere_spins": "sphere_spins",
}
"""Arrays of the state, by the names of their rows"""
SHIFTED = "initial_balloon_positions"


@dataclass(frozen=True)
class StartValue:
    """A vector that counts at the start, of one thing or several, or one number of it."""

    path: str
    name: str
    things: tuple[int, ...]
    axes: tuple[int, ...]

    def columns(self, model: Model, state: State, axis: int) -> list[wp.array]:
        """Return the arrays of shape (world_count,) that have an axis of it; none of a position of balloons."""
        if self.name == SHIFTED:
            return []
        arrays = model.parameters[self.name] if self.name in IN_PARAMETERS else getattr(state, IN_STATE[self.name])
        return [column for thing in self.things for column in columns_of(arrays, (thing, axis))]


def start_value(model: Model, path: str) -> StartValue | None:
    """Return the value that a path leads to, if it counts at the start alone.

    Raises:
        InputError: it cannot be drawn.
    """
    places = places_of(model.scene, rows_of(model.laws))
    found = places.get(path) or [place for axis in range(3) for place in places.get(f"{path}.{axis}", ())]
    if not found or not found[0][0].startswith(START):
        return None
    name = found[0][0]
    if name not in (*IN_PARAMETERS, *IN_STATE, SHIFTED):
        raise InputError(f"{path}: cannot be drawn on the device; expected a position, a velocity, or what may change")
    indices = [tuple(part for part in index if isinstance(part, int)) for _, index in found]
    value = StartValue(path, name, *(tuple(sorted({index[part] for index in indices})) for part in (0, 1)))
    if name == SHIFTED and any(model.scene.balloon[number].inflation.kind == "gas" for number in value.things):
        raise InputError(f"{path}: cannot be drawn for a balloon of gas, whose start depends on the air around it")
    if name in IN_STATE and any(model.scene.sphere[number].start > 0.0 for number in value.things):
        raise InputError(f"{path}: cannot be drawn for a sphere that appears later")
    return value


class Shifts:
    """Positions of balloons that are drawn, and where that shifts them."""

    def __init__(self, model: Model):
        self._positions = wp.zeros((3, model.world_count), dtype=wp.float32, device=model.device)
        self._centers = wp.clone(model.parameters["initial_centers"])

    def column(self, axis: int) -> Any:
        """Return the positions along an axis, shape (world_count,)."""
        return self._positions[axis]

    def shift(self, model: Model, value: StartValue, axis: int, mask: wp.array) -> None:
        """Shift the balloons of worlds that begin anew."""
        for thing in value.things:
            placed = float(np.float64(model.scene.balloon[thing].position[axis]))
            centers, shifts, moved = (
                columns_of(array, (thing, axis))[0]
                for array in (self._centers, *(model.parameters[f"initial_{name}"] for name in ("shifts", "centers")))
            )
            inputs = [mask, self._positions[axis], placed, centers]
            launch(shift_balloon, model.world_count, inputs, [shifts, moved], device=model.device)
