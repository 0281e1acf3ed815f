"""Balloons that are blown up against each other, side by side with solvers that know self-contact."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from balloon_warp.mesh.topology import quad_sphere
from balloon_warp.scene import Balloon, Inflation, Scene, Stiffness, Touch

APART = 1.05
"""between the middles of two neighbors, over the width at the start: they do not touch then"""
HELD = 0.6
"""how far the held part of each reaches from the corner that is farthest from all others, over the radius"""
PRESSURE = 12.0
"""[Pa]; a balloon by itself gets a fifth wider"""


@dataclass(frozen=True)
class CrowdCase:
    """Eight balloons in two layers of four, held from outside, that are inflated into each other.

    The rate is simulated seconds a second, in turns with a peer that has the same meshes.
    """

    name: str
    peer: Literal["newton", "blender"]
    cells: int = 8
    radius: float = 0.5
    frames: int = 10
    """that are timed together"""
    quick: bool = False

    def scene(self) -> Scene:
        """Return the scene: Blender's 24 frames a second, no gravity, and the largest stable step."""
        mesh = quad_sphere(self.cells, self.radius)
        mass = 0.3 * mesh.vertex_count / 488
        balloons = []
        for sides in ((x, y, z) for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)):
            outermost = self.radius / np.sqrt(3.0) * np.array(sides)
            held = np.linalg.norm(mesh.points - outermost, axis=1) < HELD * self.radius
            balloons.append(
                Balloon(
                    mesh=mesh,
                    position=(
                        APART * self.radius * sides[0],
                        APART * self.radius * sides[1],
                        APART * self.radius * sides[2],
                    ),
                    mass=mass,
                    damping=mass,
                    stiffness=Stiffness(structural=10.0, shear=5.0, flexion=1.0),
                    inflation=Inflation(kind="pressure", pressure=PRESSURE),
                    fixed=list[int | str](np.flatnonzero(held).tolist()),
                )
            )
        return Scene(balloon=balloons, touch=Touch(), gravity=0.0, frames_per_second=24.0)
