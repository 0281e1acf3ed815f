"""The cases, one a line."""

from dataclasses import dataclass
from typing import Literal

from balloon_warp.benchmarks.quad_sphere import quad_sphere
from balloon_warp.scene import Balloon, Ground, Inflation, Scene, Sphere, Stiffness

SUBSTEPS = 32


@dataclass(frozen=True)
class Case:
    """A batch of one balloon a world: a quad sphere of 6 cells^2 + 2 particles."""

    name: str
    schedule: str
    worlds: int
    cells: int = 9
    obstacles: bool = False
    """one sphere, which falls on the balloon and lies on it, and the ground"""
    normals: Literal["cached", "fresh"] = "cached"
    peer: bool = False
    """side by side with Newton, which has no obstacles then"""
    quick: bool = False
    """part of a quick run"""

    def scene(self) -> Scene:
        """The same springs, masses and step in every case; a particle's mass does not depend on their number."""
        weight = 0.3 * (6 * self.cells**2 + 2) / 488
        balloon = Balloon(
            mesh=quad_sphere(self.cells, radius=0.5),
            position=(0.0, 0.6, 0.0),
            mass=weight,
            damping=weight,
            stiffness=Stiffness(structural=10.0, shear=5.0, flexion=1.0),
            inflation=Inflation(k_normal=0.5),
        )
        return Scene(
            balloon=[balloon],
            sphere=[Sphere(position=(0.0, 1.4, 0.0), radius=0.2, mass=0.3)] if self.obstacles else [],
            ground=Ground() if self.obstacles else None,
            substeps=SUBSTEPS,
            normals=self.normals,
        )


GPU_CASES = [
    Case("4,096 balloons", "block", 4096, peer=True, quick=True),
    Case("4,096 balloons, sphere and ground", "block", 4096, obstacles=True, quick=True),
    Case("4,096 balloons, fresh normals", "block", 4096, normals="fresh", peer=True),
    Case("65,536 balloons", "block", 65536),
    Case("64 balloons", "block", 64),
    Case("one balloon", "block", 1, peer=True, quick=True),
    Case("one balloon, sphere and ground", "block", 1, obstacles=True),
    Case("512 balloons of 2,648 particles", "block", 512, cells=21),
    Case("4,096 balloons", "gather", 4096),
    Case("4,096 balloons", "scatter", 4096),
    Case("one balloon of 99,848 particles", "gather", 1, cells=129, quick=True),
    Case("one balloon of 99,848 particles, sphere and ground", "gather", 1, cells=129, obstacles=True),
]

CPU_CASES = [
    Case("64 balloons", "lanes", 64, peer=True, quick=True),
    Case("64 balloons, sphere and ground", "lanes", 64, obstacles=True),
    Case("64 balloons, fresh normals", "lanes", 64, normals="fresh", peer=True),
    Case("64 balloons", "gather", 64),
    Case("64 balloons", "scatter", 64),
    Case("one balloon", "octets", 1, peer=True, quick=True),
    Case("one balloon, sphere and ground", "octets", 1, obstacles=True),
    Case("one balloon, fresh normals", "octets", 1, normals="fresh", peer=True),
    Case("one balloon", "gather", 1),
]
