"""What of the parameters changes during a simulation, and when."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.model.parameters import Parameters, require_changeable, scene_parameters
from balloon_warp.scene import Scene
from balloon_warp.scene.timeline import is_there, scenes_over_time

STABILITY = {
    *("stiffness", "torsion", "viscosity", "string_stiffness", "mass", "damping", "water_density", "gravity"),
    *("drag_coefficient", "wind", "air_density", "air_pressure", "air_temperature"),
}
"""the parameters that the stable step depends on"""


@dataclass(frozen=True)
class Turn:
    """A frame at whose start parameters change, alike in all worlds."""

    frame: int
    scene: Scene
    """as it is from then on"""
    values: dict[str, tuple[NDArray[np.bool_], NDArray[np.float64]]]
    """by the parameters' names, which entries of a world change, and to what"""

    def apply(self, name: str, rows: NDArray) -> None:
        """Change a parameter's rows, shape (W, ...), in place."""
        which, values = self.values[name]
        rows[:, which] = values[which]

    def changes_stability(self, before: Scene) -> bool:
        """Whether another step may be stable than in the scene before."""
        return not STABILITY.isdisjoint(self.values) or (self.scene.substeps, self.scene.solver) != (
            before.substeps,
            before.solver,
        )


def parameters_at(scene: Scene, frame: int) -> Parameters:
    """The scene's parameters, with neither size nor strength for the spheres and strings that are not there."""
    parameters = scene_parameters(scene)
    for name, lasting in (("sphere_radius", scene.sphere), ("string_stiffness", scene.string)):
        parameters[name] = parameters[name] * [[is_there(scene, item, frame) for item in lasting]]
    return parameters


def turns(scene: Scene) -> Iterator[Turn]:
    """What changes in a scene, in order.

    Raises:
        InputError: names the change, and the path or field that is wrong.
    """
    for number, change in enumerate(scene.change):
        try:
            require_changeable(scene, change.set)
        except InputError as mistake:
            raise InputError(f"change.{number}.set: {mistake}") from None
    before = parameters_at(scene, 0)
    for frame, now in scenes_over_time(scene):
        after = parameters_at(now, frame)
        keyframes = before["keyframe_values"].shape[2] - after["keyframe_values"].shape[2]
        after["keyframe_values"] = np.pad(after["keyframe_values"], [(0, 0), (0, 0), (0, keyframes)], mode="edge")
        values = {
            name: (different, array[0])
            for name, array in after.items()
            if (different := (array[0] != before[name][0]) & ~np.isnan(array[0])).any()
        }
        yield Turn(frame, now, values)
        before = after
