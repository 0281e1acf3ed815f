"""The net force on each particle of a balloon, as lines (paper, figure 26)."""

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd

from balloon_warp.frame import Frame
from balloon_warp.mesh.geometry import total_area
from balloon_warp.model import Model
from balloon_warp.outputs.usd.lines import define_lines, write_lines
from balloon_warp.outputs.usd.material import paint
from balloon_warp.scene import Inflation
from balloon_warp.scene.colors import FORCE_COLOR


class NetForcesPrim:
    """A line from each particle along its net force.

    A force as large as the mean inflation force or the mean weight of a particle, whichever is larger, is drawn a
    twentieth of the balloon's size long; the attribute `userProperties:metersPerNewton` says how long a newton is.
    """

    def __init__(self, stage: Usd.Stage, path: Sdf.Path, model: Model, number: int):
        self.number = number
        balloon, mesh = model.scene.balloon[number], model.shapes[number].mesh
        size = float(np.ptp(mesh.points, axis=0).max())
        values = model.parameters["keyframe_values"].numpy()[0, number]
        inflation = _largest_inflation(balloon.inflation, values, total_area(mesh))
        weight = float(model.parameters["mass"].numpy()[0, number]) * abs(model.scene.gravity)
        self.meters_per_newton = 0.05 * size * mesh.vertex_count / max(inflation, weight, 1e-12)
        self.prim = define_lines(stage, path, [2] * mesh.vertex_count, width=0.003 * size)
        paint(self.prim, FORCE_COLOR, roughness=0.6)
        self.prim.GetPrim().CreateAttribute(
            "userProperties:metersPerNewton", Sdf.ValueTypeNames.Double, custom=True
        ).Set(self.meters_per_newton)

    def write(self, frame: Frame) -> None:
        begin = frame.points[self.number]
        end = begin + self.meters_per_newton * frame.net_forces[self.number]
        write_lines(self.prim, np.stack([begin, end], axis=1).reshape(-1, 3).astype(np.float32), frame.number)


def _largest_inflation(inflation: Inflation, values: NDArray[np.float32], area: float) -> float:
    """Return the forces of the inflation added up, whatever their direction, at the start or a keyframe [N]."""
    if inflation.kind == "gas":
        return abs(inflation.start_pressure) * area
    per_value = area if inflation.kind == "pressure" else 100.0
    return per_value * float(np.abs(values).max())
