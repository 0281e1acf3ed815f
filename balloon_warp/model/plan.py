"""What a model will be, on the host: nothing of it is on a device yet."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from balloon_warp.errors import InputError
from balloon_warp.model.parameters import Parameters, Vary, scene_parameters, vary_parameters
from balloon_warp.model.shape import BalloonShape, shape_balloon
from balloon_warp.model.stability import choose_substeps, stable_step
from balloon_warp.scene import Scene, String


@dataclass(frozen=True)
class ModelPlan:
    """The scene's geometry, and the parameters of every world."""

    scene: Scene
    world_count: int
    shapes: list[BalloonShape]
    held: list[int]
    """the particle that each string holds, numbered within its balloon"""
    parameters: Parameters
    substeps: int
    """as many as the stiffest world asks"""

    @property
    def particle_count(self) -> int:
        """in one world"""
        return sum(shape.mesh.vertex_count for shape in self.shapes)

    @property
    def spring_count(self) -> int:
        """in one world"""
        return sum(shape.springs.count for shape in self.shapes)


def plan_model(scene: Scene, world_count: int = 1, vary: Vary | None = None) -> ModelPlan:
    """Read the scene's meshes, string them, and give each world its parameters.

    Raises:
        InputError: a mesh cannot be read or strung, a particle is not in its balloon, a varied value is wrong, or the
            step is not stable.
    """
    if world_count < 1:
        raise InputError(f"world_count: must be at least 1 (got {world_count})")
    shapes = [shape_balloon(balloon, scene) for balloon in scene.balloon]
    held = [_held_particle(number, string, scene, shapes) for number, string in enumerate(scene.string)]
    lengths = [_string_length(string, particle, shapes) for string, particle in zip(scene.string, held, strict=True)]
    parameters = vary_parameters(scene_parameters(scene, lengths), scene, world_count, vary or {})
    return ModelPlan(
        scene=scene,
        world_count=world_count,
        shapes=shapes,
        held=held,
        parameters=parameters,
        substeps=choose_substeps(scene, stable_step(scene, shapes, held, parameters)),
    )


def _held_particle(number: int, string: String, scene: Scene, shapes: Sequence[BalloonShape]) -> int:
    """The particle that a string holds, numbered within its balloon."""
    mesh = shapes[string.balloon].mesh
    if isinstance(string.particle, str):
        used = np.unique(mesh.face_vertex_indices)
        heights = mesh.points[used] @ np.array(scene.up)
        return int(used[heights.argmax() if string.particle == "highest" else heights.argmin()])
    if string.particle >= mesh.vertex_count:
        raise InputError(
            f"string.{number}.particle: {mesh.name} has particles 0 to {mesh.vertex_count - 1} (got {string.particle})"
        )
    return string.particle


def _string_length(string: String, particle: int, shapes: Sequence[BalloonShape]) -> float:
    at_start = shapes[string.balloon].mesh.points[particle] - np.array(string.anchor)
    return string.length or float(np.linalg.norm(at_start))
