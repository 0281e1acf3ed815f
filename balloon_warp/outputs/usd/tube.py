"""A tube between two balloons in the stage."""

import numpy as np
from pxr import Sdf, Usd

from balloon_warp.frame import Frame
from balloon_warp.model import Model
from balloon_warp.outputs.usd.lines import define_lines
from balloon_warp.outputs.usd.material import paint
from balloon_warp.outputs.usd.strand import Strand
from balloon_warp.scene.colors import STRING_COLOR


class TubePrim:
    """Tube of the scene, as a straight curve and the mesh around it.

    It goes between the particles that face each other at the start.
    """

    def __init__(self, stage: Usd.Stage, path: Sdf.Path, model: Model, number: int):
        self.balloons = model.scene.tube[number].balloons
        first, second = (model.shapes[balloon].mesh.points for balloon in self.balloons)
        toward = second.mean(axis=0) - first.mean(axis=0)
        self.particles = int((first @ toward).argmax()), int((second @ toward).argmin())
        size = min(float(np.ptp(points, axis=0).max()) for points in (first, second))
        self.prim = define_lines(stage, path, [2], width=0.1 * size)
        paint(self.prim, STRING_COLOR, roughness=0.5)
        ends = first[self.particles[0]], second[self.particles[1]]
        self._strand = Strand(stage, self.prim, np.array(ends))

    def write(self, frame: Frame) -> None:
        ends = zip(self.balloons, self.particles, strict=True)
        places = np.stack([frame.points[balloon][particle] for balloon, particle in ends])
        self._strand.write(places, frame.number)
