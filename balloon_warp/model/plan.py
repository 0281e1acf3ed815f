"""Plan of a model on the host, before anything is on a device.

The scene's meshes become shapes. Its numbers become parameters, by the rows of its laws. Values that vary get a row for
each world. Missing values get their defaults. Then the substeps follow from all of these.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.garbage import without_collecting
from balloon_warp.kernels.laws import LAWS, Law
from balloon_warp.kernels.laws.membrane import SHEAR_MODULUS
from balloon_warp.kernels.laws.outer import EVENED
from balloon_warp.laws import require_laws
from balloon_warp.model.crushing import crushed_starts
from balloon_warp.model.following import follow_changes
from balloon_warp.model.gas import require_openings, require_sealed, settle_gas
from balloon_warp.model.materials import settle_masses, settle_tears
from balloon_warp.model.obstacles import (
    BodyShape,
    ObstacleShape,
    settle_bodies,
    settle_friction,
    shape_body,
    shape_obstacle,
    substeps_of_solids,
    with_parts_apart,
)
from balloon_warp.model.parameters import Parameters, parameters_at, rows_of, with_law_tables
from balloon_warp.model.pressure import pressures_too_high, settle_bearing, settle_pressure
from balloon_warp.model.remarks import doubts_about
from balloon_warp.model.ridges import Ridges, all_ridges, kept_distance
from balloon_warp.model.shape import BalloonShape, shape_balloon
from balloon_warp.model.stability import Network, choose_substeps, names_of_the_step, warnings_of
from balloon_warp.model.starts import require_same_extreme, settle_starts, start_velocities
from balloon_warp.model.strain_bound import StrainBound, bounded_films, bounded_moduli, cut_to_size
from balloon_warp.model.strings import (
    Driven,
    driven_particles,
    held_particle,
    overstretched_strings,
    require_profile,
    string_lengths,
)
from balloon_warp.model.timeline import DueChange, due_changes
from balloon_warp.model.touch import crossed_starts, settle_itself, settle_touch
from balloon_warp.model.vary import Vary, vary_parameters
from balloon_warp.scene import Scene


@dataclass(frozen=True)
class ModelPlan:
    """The scene's geometry, and the parameters of every world."""

    scene: Scene
    world_count: int
    shapes: list[BalloonShape]
    obstacles: list[ObstacleShape]
    bodies: list[BodyShape]
    ridges: list[Ridges]
    """Ridges of obstacles, and then of bodies, that faces of balloons touch; empty where they touch none"""
    held: list[int]
    """Particle that each string holds, numbered within its balloon"""
    driven: Driven
    """Particles that outer forces drive"""
    own_laws: tuple[Law, ...]
    """User-defined laws that act"""
    parameters: Parameters
    substeps: int
    """Number of substeps at the start, by the stiffest world"""
    due_changes: list[DueChange]
    """Changes during the simulation"""
    strain_bound: StrainBound | None = None
    """Films whose moduli are lower than their materials', if there are any"""

    @property
    def laws(self) -> tuple[Law, ...]:
        return (*LAWS, *self.own_laws)

    @property
    def reach(self) -> Mapping[str, Sequence[NDArray[np.float32]]]:
        """Nothing is written on the device yet, see `Model.reach`."""
        return {}

    def of_world(self, name: str, world: int) -> Any:
        """Return a parameter of one world, as a number or lists of numbers."""
        values = self.parameters[name]
        return values[world % len(values)].tolist()

    def of_worlds(self, rows: NDArray[np.integer]) -> Self:
        """Return the plan of some of the worlds, with the step that is planned for all."""
        parameters = {name: values[rows] if len(values) > 1 else values for name, values in self.parameters.items()}
        return replace(self, world_count=len(rows), parameters=parameters)

    def with_times_the_substeps(self, times: int) -> Self:
        """Return the plan with a multiple of the substeps, at all times."""

        def finer(scene: Scene) -> Scene:
            auto = scene.substeps == "auto"
            return scene if auto else scene.model_copy(update={"substeps": times * scene.substeps})

        changes = [replace(change, scene=finer(change.scene)) for change in self.due_changes]
        return replace(self, scene=finer(self.scene), substeps=times * self.substeps, due_changes=changes)

    @property
    def warnings(self) -> list[str]:
        """Warnings in sentences.

        They are on: parts of stages that were left out; values that may be in another unit; defects of meshes, and
        their treatment; spheres that may pass through balloons; pressures that rubber does not bear; layers that start
        crossed; strings that start overstretched; balloons that water crushes.
        """
        step_seconds = 1.0 / self.scene.frames_per_second / self.substeps
        solids = [*self.obstacles, *(body.solid for body in self.bodies)]
        taken = list(dict.fromkeys(remark for solid in solids for remark in solid.remarks))
        passing = warnings_of(self.scene, self.shapes, self.parameters["sphere_radius"], step_seconds)
        passing += pressures_too_high(self.scene, self.shapes, self.parameters)
        doubts = doubts_about(self.scene, self.shapes, self.parameters)
        passing += crushed_starts(self.scene, self.shapes, self.parameters)
        passing += crossed_starts(self.scene, self.shapes, self.parameters)
        tied = self.scene, self.shapes, self.bodies, self.held, self.parameters
        return taken + doubts + passing + overstretched_strings(*tied)

    @property
    def particle_count(self) -> int:
        """Number of particles in one world."""
        return sum(shape.mesh.vertex_count for shape in self.shapes)

    @property
    def spring_count(self) -> int:
        """Number of springs in one world."""
        return sum(shape.springs.count for shape in self.shapes)


@without_collecting()
def plan_model(
    scene: Scene,
    world_count: int = 1,
    vary: Vary | None = None,
    shapes: list[BalloonShape] | None = None,
    laws: Sequence[Law] = (),
) -> ModelPlan:
    """Read the scene's meshes, string them, and give each world its parameters.

    Args:
        shapes: of the scene's balloons, where they are known already.
        laws: User-defined laws beside the built-in ones.

    Raises:
        InputError: a law is not right, a mesh cannot be read or strung, or not hold gas, a particle is not in its
            balloon, a balloon starts inside an obstacle, a varied value is wrong, or the step is not stable.
    """
    if world_count < 1:
        raise InputError(f"world_count: must be at least 1 (got {world_count})")
    require_laws(laws)
    rows = rows_of((*LAWS, *laws))
    scene = with_parts_apart(with_law_tables(scene, rows))
    shapes = shapes or [shape_balloon(balloon, scene) for balloon in scene.balloon]
    scene = settle_itself(scene, shapes)
    held = [held_particle(number, string, scene, shapes) for number, string in enumerate(scene.string)]
    said = vary_parameters(parameters_at(scene, rows, 0), scene, rows, world_count, vary or {})
    bodies = [shape_body(number, body, scene) for number, body in enumerate(scene.body)]
    changes = list(due_changes(scene, rows))
    parameters = _settled(scene, shapes, bodies, held, said, changes, vary or {})
    uncut, exact = shapes, said[SHEAR_MODULUS.name]
    shapes = cut_to_size(scene, shapes, parameters, exact)
    obstacles = [shape_obstacle(number, obstacle, scene) for number, obstacle in enumerate(scene.obstacle)]
    parameters |= settle_bodies(scene, bodies, parameters)
    if obstacles:
        from balloon_warp.model.clear_starts import require_clear_starts  # takes long to load

        require_clear_starts(scene, shapes, obstacles, parameters)
    if bodies:
        from balloon_warp.model.clear_starts import require_clear_bodies  # takes long to load

        require_clear_bodies(scene, shapes, obstacles, bodies, parameters)
    ridges = all_ridges(scene, shapes, obstacles, bodies)
    if ridges and obstacles:
        from balloon_warp.model.flush import exposed_ridges  # takes long to load

        ridges = exposed_ridges(scene, obstacles, ridges, parameters, changes, kept_distance(shapes))
    network = Network(shapes, held, (*LAWS, *laws), bodies)
    substeps = substeps_over_time(scene, network, parameters, changes, start_velocities(shapes, parameters))
    if scene.substeps == "auto":
        substeps = max(substeps, substeps_of_solids(scene, bodies, parameters))
    bound = _strain_bound(scene, replace(network, shapes=uncut), parameters, exact, changes, substeps)
    return ModelPlan(
        scene=scene,
        world_count=world_count,
        shapes=shapes,
        obstacles=obstacles,
        bodies=bodies,
        ridges=ridges,
        held=held,
        driven=driven_particles(scene, shapes),
        own_laws=tuple(laws),
        parameters=parameters,
        substeps=substeps,
        due_changes=changes,
        strain_bound=bound,
    )


def settled_parameters(plan: ModelPlan, vary: Vary) -> Parameters:
    """Return the parameters that a plan of the same shapes has where other values vary, not rounded as devices do.

    Raises:
        InputError: as `plan_model`, where a value is wrong.
    """
    rows = rows_of(plan.laws)
    said = vary_parameters(parameters_at(plan.scene, rows, 0), plan.scene, rows, plan.world_count, vary)
    return _settled(plan.scene, plan.shapes, plan.bodies, plan.held, said, plan.due_changes, vary, rounded=False)


def _settled(
    scene: Scene,
    shapes: Sequence[BalloonShape],
    bodies: Sequence[BodyShape],
    held: Sequence[int],
    said: Mapping[str, NDArray[np.float64]],
    changes: Sequence[DueChange],
    varied: Collection[str],
    rounded: bool = True,
) -> Parameters:
    """Return the parameters with those that follow from them and from the shapes.

    They are the balloons' starting places, string lengths, "auto" pressures, moduli of film, and amounts of gas.

    Raises:
        InputError: a balloon cannot hold gas, or let it out so, is too far away for float32, or cannot be turned so.
    """
    for balloon, shape in zip(scene.balloon, shapes, strict=True):
        if balloon.inflation.kind == "gas":
            require_sealed(shape)
    parameters = dict(said) | {"mass": settle_masses(scene, shapes, dict(said))}
    parameters |= settle_starts(scene, shapes, parameters)
    for name in ("initial_balloon_positions", "initial_rotations"):
        del parameters[name]
    for number, particle in enumerate(held):
        require_same_extreme(scene, parameters, number, shapes[scene.string[number].balloon], particle)
    parameters["string_length"] = string_lengths(scene, shapes, bodies, held, parameters)
    require_openings(scene, shapes, parameters)
    require_profile(parameters)
    parameters["keyframe_values"] = settle_pressure(scene, shapes, parameters)
    parameters[SHEAR_MODULUS.name] = bounded_moduli(scene, shapes, parameters, changes, varied)
    parameters |= settle_touch(scene, shapes, parameters) | settle_friction(parameters, rounded)
    parameters |= settle_tears(scene, parameters)
    parameters |= settle_gas(scene, shapes, parameters, rounded)
    return parameters | {EVENED.name: settle_bearing(scene, shapes, parameters)}


def _strain_bound(
    scene: Scene,
    network: Network,
    parameters: Parameters,
    exact: NDArray[np.float64],
    changes: Sequence[DueChange],
    substeps: int,
) -> StrainBound | None:
    """Return which films are bounded, and the substeps that this spares; None where none is."""
    films = bounded_films(scene, network.shapes, parameters, exact, changes)
    if not films:
        return None
    spared = None
    if scene.substeps == "auto":
        spared = substeps_over_time(scene, network, {**parameters, SHEAR_MODULUS.name: exact}, changes, None)
    return StrainBound(films, substeps, spared)


def substeps_over_time(
    scene: Scene,
    network: Network,
    parameters: Parameters,
    changes: Sequence[DueChange],
    velocities: Sequence[NDArray[np.float64]] | None,
) -> int:
    """Return the number of substeps at the start.

    With "auto", they suffice for the whole simulation; otherwise the scene's must suffice until they change.

    Args:
        velocities: at the start, as `Network.stable_step` has them.

    Raises:
        InputError: they do not suffice, or a value that changes differs between worlds.
    """
    chosen = [_substeps(scene, network, parameters, velocities)]
    values, before = dict(parameters), scene
    for turn in changes:
        then = dict(values)
        for name, (which, _) in turn.values.items():
            if (values[name][:, which] != values[name][0, which]).any():
                named = name.replace("_", " ")
                raise InputError(f"{named}: changes during the simulation, and so cannot differ between worlds")
            then[name] = values[name].copy()
            turn.apply(name, then[name])
        follow_changes(turn.scene, network.shapes, values, then)
        values = then
        methods_change = (turn.scene.substeps, turn.scene.solver) != (before.substeps, before.solver)
        if methods_change or not names_of_the_step(turn.scene, network.laws).isdisjoint(turn.values):
            chosen.append(_substeps(turn.scene, network, values))
        before = turn.scene
    return max(chosen) if scene.substeps == "auto" else chosen[0]


def _substeps(
    scene: Scene, network: Network, parameters: Parameters, velocities: Sequence[NDArray[np.float64]] | None = None
) -> int:
    """Return the number of substeps in a frame with these parameters."""
    stable = network.stable_step(scene, parameters, velocities)
    return choose_substeps(scene, stable, network.auto_step(scene, parameters, velocities, stable))
