"""Prototypes that the worlds of a batch share in the stage: topology, materials, widths.

Each world refers to them.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd

from balloon_warp.model import ModelPlan
from balloon_warp.model.obstacle_motion import obstacle_motion, obstacle_poses
from balloon_warp.outputs.knot import has_knot
from balloon_warp.outputs.usd.balloon import define_balloon
from balloon_warp.outputs.usd.body import body_names, define_body
from balloon_warp.outputs.usd.knot import define_knot, knot_path
from balloon_warp.outputs.usd.names import prim_names, show_names
from balloon_warp.outputs.usd.obstacle import Look, define_obstacle, obstacle_names
from balloon_warp.outputs.usd.planes import Plane, define_square
from balloon_warp.outputs.usd.sphere import define_sphere
from balloon_warp.outputs.usd.string import define_string

HOME = Sdf.Path("/World/Prototypes")


class Prototypes:
    """Abstract prims, one for each balloon's mesh, or each of its meshes, sphere, string, obstacle and free body.

    Args:
        plans: Plans of all groups of worlds.
        middle: Middle of the worlds at the start, before they are put side by side [m], shape (3,).
        half: Half the side of the square that is drawn of an obstacle's plane [m].
    """

    def __init__(self, stage: Usd.Stage, plans: Sequence[ModelPlan], middle: NDArray[np.float64], half: float):
        stage.CreateClassPrim(HOME)
        scene = plans[0].scene
        shapes = {_key(plan, number): shape for plan in plans for number, shape in enumerate(plan.shapes)}
        self.spheres = [HOME.AppendChild(f"Sphere_{number}") for number in range(len(scene.sphere))]
        self.strings = [HOME.AppendChild(f"String_{number}") for number in range(len(scene.string))]
        self.pieces: dict[Plane, Sdf.Path] = {}
        bodies = [path.name for path in (*self.spheres, *self.strings, *map(knot_path, self.strings))]
        self.obstacles = [HOME.AppendChild(name) for name in obstacle_names(scene, bodies)]
        self.obstacle_motion = obstacle_motion(scene)
        named = [*bodies, *(path.name for path in self.obstacles)]
        self.bodies = [HOME.AppendChild(name) for name in body_names(scene, named)]
        self.other_names = [*named, *(path.name for path in self.bodies)]
        names = prim_names((shape.mesh.name for shape in shapes.values()), self.other_names)
        self._balloons = {key: HOME.AppendChild(name) for key, name in zip(shapes, names, strict=True)}
        for key, shape in shapes.items():
            define_balloon(stage, self._balloons[key], shape, key[0], scene.balloon[key[0]])
        for number, path in enumerate(self.spheres):
            define_sphere(stage, path, scene.sphere[number], number)
        poses = obstacle_poses(plans[0].parameters["obstacle_position"][0], self.obstacle_motion, 0)
        for path, obstacle, shape, pose in zip(self.obstacles, scene.obstacle, plans[0].obstacles, poses, strict=True):
            define_obstacle(stage, path, obstacle, shape, pose, Look(scene.up_axis, middle, half))
        for number, path in enumerate(self.bodies):
            define_body(stage, path, scene, plans[0].bodies[number], number)
        for paths, named in ((self.obstacles, scene.obstacle), (self.bodies, scene.body)):
            show_names(stage.GetRootLayer(), paths, [each.name for each in named])
        self.string_widths = [
            define_string(stage, path, plans[0].shapes[string.balloon].mesh).GetWidthsAttr().Get()
            for path, string in zip(self.strings, scene.string, strict=True)
        ]
        self.knots: dict[int, Sdf.Path] = {}
        """Knots of the strings that have one, by their numbers"""
        for number, string in enumerate(scene.string):
            if has_knot(string, scene.balloon[string.balloon]):
                self.knots[number] = knot_path(self.strings[number])
                define_knot(stage, self.knots[number], scene, number, plans[0].shapes[string.balloon].mesh)

    def define_piece(
        self, stage: Usd.Stage, plane: Plane, middle: NDArray[np.float64], half: float, up_axis: str
    ) -> None:
        """Define the piece of a plane of each world, at height 0, where heights differ.

        Arguments are those of `define_square`.
        """
        self.pieces[plane] = HOME.AppendChild(plane.piece)
        define_square(stage, self.pieces[plane], plane, middle, half, 0.0, up_axis)

    def balloon(self, plan: ModelPlan, number: int) -> Sdf.Path:
        """Return the prototype of a balloon of this plan."""
        return self._balloons[_key(plan, number)]


def _key(plan: ModelPlan, number: int) -> tuple[int, Path | int]:
    mesh = plan.scene.balloon[number].mesh
    return number, mesh if isinstance(mesh, Path) else id(mesh)
