"""What a model will be, on the host: nothing of it is on a device yet."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.mesh.size import require_reach
from balloon_warp.model.air import require_sealed, settle_gas
from balloon_warp.model.parameters import Parameters, Vary, vary_parameters
from balloon_warp.model.shape import BalloonShape, shape_balloon
from balloon_warp.model.stability import choose_substeps, stable_step
from balloon_warp.model.timeline import Turn, parameters_at, turns
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
    """at the start: as many as the stiffest world asks"""
    turns: list[Turn]
    """what changes during the simulation"""

    def of_world(self, name: str, world: int) -> Any:
        """A parameter of one world, as a number or lists of numbers."""
        values = self.parameters[name]
        return values[world % len(values)].tolist()

    def of_worlds(self, rows: NDArray[np.integer]) -> Self:
        """Some of the worlds, with the step that is planned for all."""
        parameters = {name: values[rows] if len(values) > 1 else values for name, values in self.parameters.items()}
        return replace(self, world_count=len(rows), parameters=parameters)

    def with_times_the_substeps(self, times: int) -> Self:
        """The same in shorter steps, wherever the scene says how long they are."""

        def finer(scene: Scene) -> Scene:
            auto = scene.substeps == "auto"
            return scene if auto else scene.model_copy(update={"substeps": times * scene.substeps})

        turns = [replace(turn, scene=finer(turn.scene)) for turn in self.turns]
        return replace(self, scene=finer(self.scene), substeps=times * self.substeps, turns=turns)

    @property
    def position_shifts(self) -> NDArray[np.float64]:
        """how far each balloon starts from where the scene puts it [m], shape (W, balloon_count, 3)"""
        return position_shifts(self.scene, self.parameters)

    @property
    def warnings(self) -> list[str]:
        """what is odd about the meshes, and what became of it"""
        return [warning for shape in self.shapes for warning in shape.warnings]

    @property
    def particle_count(self) -> int:
        """in one world"""
        return sum(shape.mesh.vertex_count for shape in self.shapes)

    @property
    def spring_count(self) -> int:
        """in one world"""
        return sum(shape.springs.count for shape in self.shapes)


def plan_model(
    scene: Scene, world_count: int = 1, vary: Vary | None = None, shapes: list[BalloonShape] | None = None
) -> ModelPlan:
    """Read the scene's meshes, string them, and give each world its parameters.

    Args:
        shapes: of the scene's balloons, where they are known already.

    Raises:
        InputError: a mesh cannot be read or strung, or not hold gas, a particle is not in its balloon, a varied value
            is wrong, or the step is not stable.
    """
    if world_count < 1:
        raise InputError(f"world_count: must be at least 1 (got {world_count})")
    shapes = shapes or [shape_balloon(balloon, scene) for balloon in scene.balloon]
    for balloon, shape in zip(scene.balloon, shapes, strict=True):
        if balloon.inflation.kind == "gas":
            require_sealed(shape)
    held = [_held_particle(number, string, scene, shapes) for number, string in enumerate(scene.string)]
    parameters = vary_parameters(parameters_at(scene, 0), scene, world_count, vary or {})
    shifts = position_shifts(scene, parameters)
    for number, shape in enumerate(shapes):
        require_reach(shape.mesh, shape.name, shifts[:, number])
    parameters["string_length"] = _string_lengths(scene, shapes, held, parameters)
    parameters = settle_gas(scene, shapes, shifts, parameters)
    changes = list(turns(scene))
    return ModelPlan(
        scene=scene,
        world_count=world_count,
        shapes=shapes,
        held=held,
        parameters=parameters,
        substeps=_substeps(scene, changes, lambda now, values: stable_step(now, shapes, held, values), parameters),
        turns=changes,
    )


def _substeps(
    scene: Scene,
    changes: Sequence[Turn],
    stable: Callable[[Scene, Parameters], float],
    parameters: Parameters,
) -> int:
    """Substeps at the start. Left to us, they are enough for all that follows; else the scene's, which must be enough
    until they change.

    Raises:
        InputError: they are not, or what changes differs between worlds.
    """
    steps = [stable(scene, parameters)]
    chosen = [choose_substeps(scene, steps[0])]
    values, before = {name: rows.copy() for name, rows in parameters.items()}, scene
    for turn in changes:
        for name in turn.values:
            if (values[name][:, turn.values[name][0]] != values[name][0, turn.values[name][0]]).any():
                named = name.replace("_", " ")
                raise InputError(f"{named}: changes during the simulation, and so cannot differ between worlds")
            turn.apply(name, values[name])
        if turn.changes_stability(before):
            steps.append(stable(turn.scene, values))
            chosen.append(choose_substeps(turn.scene, steps[-1]))
        before = turn.scene
    return max(chosen) if scene.substeps == "auto" else chosen[0]


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


def position_shifts(scene: Scene, parameters: Parameters) -> NDArray[np.float64]:
    """How far each balloon starts from where the scene puts it [m], shape (W, balloon_count, 3)."""
    return parameters["initial_balloon_positions"] - np.array([balloon.position for balloon in scene.balloon])


def _string_lengths(
    scene: Scene, shapes: Sequence[BalloonShape], held: Sequence[int], parameters: Parameters
) -> NDArray[np.float64]:
    """Where the scene says none, the distance [m] from anchor to particle at the start, shape (W, string_count)."""
    lengths = parameters["string_length"]
    if not np.isnan(lengths).any():
        return lengths
    balloons = [string.balloon for string in scene.string]
    points = np.array([shapes[balloon].mesh.points[particle] for balloon, particle in zip(balloons, held, strict=True)])
    starts = points + position_shifts(scene, parameters)[:, balloons]
    return np.where(np.isnan(lengths), np.linalg.norm(starts - parameters["string_anchor"], axis=-1), lengths)
