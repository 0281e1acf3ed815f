"""Points that an animation leads: pin groups that move, and obstacles that bend."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from balloon_warp.blender.request import Led
from balloon_warp.frame import Frame
from balloon_warp.simulator import Simulator


class Leading:
    """Gives fixed particles the velocities that take them to their places in the next frame.

    A particle without mass keeps its velocity: no force changes it, and it moves on a line through the frame.

    Args:
        simulator: of the balloons.
        led: their particles.
    """

    def __init__(self, simulator: Simulator, led: Sequence[Led]):
        self._simulator, self._led = simulator, led
        shapes = simulator.model.shapes
        self._firsts = np.cumsum([0, *(shape.mesh.vertex_count for shape in shapes)])
        """Number of each balloon's first particle"""
        self._vertices: list[NDArray[np.int64]] = [
            np.array([shapes[each.balloon].mesh.stand_in(int(particle)) for particle in each.particles]) for each in led
        ]

    def lead(self, frame: Frame) -> None:
        """Lead from a frame to the next; after the last all stay."""
        if not self._led:
            return
        velocities = self._simulator.state.velocities.numpy().copy()
        for each, vertices in zip(self._led, self._vertices, strict=True):
            places = each.places[min(frame.number + 1, len(each.places) - 1)]
            way = places - frame.points[each.balloon][vertices]
            velocities[0, self._firsts[each.balloon] + vertices] = way / self._simulator.model.frame_seconds
        self._simulator.state.velocities.assign(velocities)
