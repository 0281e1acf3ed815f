"""Plan of a model on the host, before anything is on a device; remarks on its values, and the model built from it.

The scene's meshes become shapes. Its numbers become parameters, by the rows of its laws. Values that vary get a row for
each world. Missing values get their defaults. Then the substeps follow from all of these.
"""

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, Self

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from balloon_warp.errors import InputError
from balloon_warp.kernels.frame import place_balloons
from balloon_warp.kernels.laws import LAWS, Law
from balloon_warp.kernels.laws.gas import max_pressure
from balloon_warp.kernels.laws.membrane import SHEAR_MODULUS
from balloon_warp.kernels.laws.outer import EVENED
from balloon_warp.laws import require_laws
from balloon_warp.mesh.load import size_of
from balloon_warp.mesh.polygon_mesh import METERS, NO_AXIS
from balloon_warp.model.materials import resolve_masses, resolve_tears
from balloon_warp.model.model import Model
from balloon_warp.model.obstacles import (
    BodyShape,
    ObstacleShape,
    obstacle_motion,
    resolve_bodies,
    resolve_friction,
    shape_body,
    shape_obstacle,
    substeps_of_solids,
    warp_mesh,
    with_parts_apart,
)
from balloon_warp.model.parameters import (
    DueChange,
    Parameters,
    Vary,
    all_columns,
    due_changes,
    pack,
    parameters_at,
    rows_of,
    vary_parameters,
    views_of,
    with_law_tables,
)
from balloon_warp.model.pressure import (
    pressures_too_high,
    require_openings,
    require_sealed,
    resolve_bearing,
    resolve_gas,
    resolve_pressure,
)
from balloon_warp.model.shape import BalloonShape, shape_balloon
from balloon_warp.model.stability import (
    Network,
    StrainBound,
    bounded_films,
    bounded_moduli,
    choose_substeps,
    cut_to_size,
    names_of_the_step,
    update_dependents,
    warnings_of,
)
from balloon_warp.model.starts import (
    Carriers,
    Driven,
    crushed_starts,
    driven_particles,
    held_particle,
    overstretched_strings,
    require_profile,
    require_same_extreme,
    resolve_starts,
    start_velocities,
    string_lengths,
)
from balloon_warp.model.state import State
from balloon_warp.model.touch import (
    Ridges,
    all_ridges,
    crossed_starts,
    kept_distance,
    resolve_self_contact,
    resolve_touch,
    ridge_tree,
)
from balloon_warp.scene import Balloon, Scene
from balloon_warp.system.process import without_garbage_collection
from balloon_warp.system.warp_setup import begin_driver
from balloon_warp.system.warp_threads import begin_loading, lock_of, pick_device

SMALLEST, LARGEST = 0.02, 30.0
"""Range of balloon sizes without a warning [m]"""
TOLD = (0.002, 300.0)
"""Range of sizes without a warning, where the unit is given [m]"""
THICKEST = 0.05
"""Largest wall thickness over a balloon's size"""
HEAVIEST = 100.0
"""Largest mass over that of the air in a sphere of the balloon's size"""
LIGHT = 5.0
"""Largest mass without a warning [kg]: a mesh by itself has less"""
LIFTED = 100.0
"""Largest lift by helium over weight"""
AIR = 1.2
"""Density of air [kg/m^3]"""


def implausible_values(scene: Scene, shapes: Sequence[BalloonShape], parameters: Parameters) -> list[str]:
    """Return warnings of values that may be in another unit, or of another sign, in any world.

    Of gravity, and of balloons' sizes, walls, masses and lift. Also of meshes turned to an up axis that their files do
    not name.
    """
    found = []
    if (gravity := float(parameters["gravity"].min())) < 0.0:
        found.append(f"gravity: {gravity:g} m/s2 pulls up, since positive is down; meant {-gravity:g}?")
    for number, (balloon, shape) in enumerate(zip(scene.balloon, shapes, strict=True)):
        size, mass = size_of(shape.mesh), float(parameters["mass"][:, number].max())
        if not SMALLEST <= size <= LARGEST and balloon.unit is None:
            found.append(f"{shape.name}: {size:.3g} m? {_helps(balloon, shape, size)}")
        elif not TOLD[0] <= size <= TOLD[1]:
            found.append(f"{shape.name}: {size:.3g} m? --unit {balloon.unit}?")
        if scene.up_axis != "Y" and isinstance(balloon.mesh, Path) and not shape.mesh.up_known:
            found.append(
                f"{shape.name}: its {NO_AXIS}, so its Y is turned to up_axis, {scene.up_axis}; --up {scene.up_axis} "
                f'(up = "{scene.up_axis}") keeps the mesh as it is'
            )
        thickness = float(parameters["thickness"][:, number].max()) if balloon.material.is_membrane else 0.0
        if thickness > THICKEST * size:
            wall = f"a wall {thickness:.3g} m thick, for a balloon of {size:.3g} m?"
            found.append(f"{shape.name}: {wall} material.thickness is in meters")
        if mass > max(LIGHT, HEAVIEST * AIR * np.pi / 6.0 * size**3):
            found.append(
                f"{shape.name}: a mass of {mass:.3g} kg, for a balloon of {size:.3g} m? Masses are in kilograms"
            )
        lift, weight = float(parameters["helium"][:, number].max()), float(np.abs(parameters["gravity"]).max())
        if lift > LIFTED * max(weight, 1.0):
            found.append(
                f"{shape.name}: helium accelerates upward by {lift:g} m/s2? {1.2 * weight:.3g} lets it rise slowly"
            )
    return found


def _helps(balloon: Balloon, shape: BalloonShape, size: float) -> str:
    """Return the option or field that would give the balloon an ordinary size."""
    units = [unit for unit in ("cm", "mm", "in", "ft") if SMALLEST <= size * METERS[unit] <= LARGEST]
    if size > LARGEST and units and not shape.mesh.unit_known:
        return f"--unit {units[0]}?"
    return f"balloon.scale = {10.0 ** -round(np.log10(size)) * balloon.scale:g}?"


@dataclass(frozen=True)
class Remark:
    """Remark on a world."""

    kind: Literal["unsettled", "overstretched", "pressed"]
    world: int
    frame: int
    sentence: str


def remarks_on(model: Model, state: State, worlds: NDArray[np.integer] | None = None) -> list[Remark]:
    """Return the current remarks, world by world.

    Args:
        model: Model that was simulated.
        state: State of all its worlds.
        worlds: Numbers by which the worlds are named; their order, when missing.
    """
    with lock_of(model.device):
        return _found(model, state, np.arange(model.world_count) if worlds is None else worlds)


def _found(model: Model, state: State, worlds: NDArray[np.integer]) -> list[Remark]:
    unsettled, overstretched = state.unsettled.numpy(), state.overstretched.numpy()
    found = []
    for row in np.flatnonzero(unsettled[:, 0]).tolist():
        world, frame = int(worlds[row]), int(unsettled[row, 0])
        found.append(Remark("unsettled", world, frame, _unsettled(model, frame, world, float(unsettled[row, 1]))))
    for row in np.flatnonzero(overstretched).tolist():
        world, frame = int(worlds[row]), int(overstretched[row])
        found.append(Remark("overstretched", world, frame, _overstretched(model, frame, world, row)))
    for row, balloon in np.argwhere(state.pressed.numpy()).tolist():
        world, frame = int(worlds[row]), int(state.pressed.numpy()[row, balloon])
        found.append(Remark("pressed", world, frame, _pressed(model, frame, world, row, balloon)))
    return found


def remarks_in_sentences(model: Model, state: State) -> list[str]:
    """Return remarks on a model and a state as sentences, as `remarks_on`."""
    return remark_sentences(remarks_on(model, state))


def remark_sentences(remarks: Sequence[Remark]) -> list[str]:
    """Return one sentence for each kind: of its first world, and how many others there are."""
    counts = Counter(remark.kind for remark in remarks)
    firsts = {remark.kind: remark for remark in sorted(remarks, key=lambda remark: remark.world, reverse=True)}
    more = {kind: f" (and {_others(count - 1)})" if count > 1 else "" for kind, count in counts.items()}
    return [f"{firsts[kind].sentence}{more[kind]}" for kind in counts]


def _others(count: int) -> str:
    return "1 more world" if count == 1 else f"{count:,} more worlds"


def _unsettled(model: Model, frame: int, world: int, change: float) -> str:
    said = model.scene.solver_iterations
    helps = "more substeps or softer springs help" if said == "auto" else 'solver_iterations = "auto" helps'
    return (
        f'solver "projective": the iterations did not converge in frame {frame} of world {world}: the last one changed '
        f"the springs' displacements by {change:.1%}, so balloons are too stiff or too small; {helps}"
    )


def _overstretched(model: Model, frame: int, world: int, row: int) -> str:
    parameters = {name: model.parameters[name].numpy() for name in ("gent_limit", "most_stretch")}
    number = [balloon.material.law for balloon in model.scene.balloon].index("gent")
    limit, most = (float(values[row % len(values), number]) for values in parameters.values())
    lock = (0.5 * (limit + 3.0)) ** 0.5
    return (
        f"material.most_stretch: rubber exceeded a biaxial stretch of {most:.3g} in frame {frame} of world {world}; "
        f'beyond, the tension of "gent", which locks at {lock:.3g}, is extrapolated; less gas or pressure, a larger '
        "gent_limit or a larger most_stretch helps"
    )


def _pressed(model: Model, frame: int, world: int, row: int, balloon: int) -> str:
    masses = model.parameters["mass"].numpy()
    bound = model.shapes[balloon].pressure_bound
    most = max_pressure(bound, float(masses[row % len(masses), balloon]), model.step_seconds)
    return (
        f"{model.shapes[balloon].name}: its gas was pressed in frame {frame} of world {world} and pushed with just "
        f"{most:,.3g} Pa, at which its skin is stable in {model.substeps:,} substeps a frame; more substeps help"
    )


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
        doubts = implausible_values(self.scene, self.shapes, self.parameters)
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


@without_garbage_collection()
def plan_model(
    scene: Scene,
    world_count: int = 1,
    vary: Vary | None = None,
    shapes: list[BalloonShape] | None = None,
    laws: Sequence[Law] = (),
    films: Mapping[int, float] | None = None,
) -> ModelPlan:
    """Read the scene's meshes, string them, and give each world its parameters.

    Args:
        shapes: of the scene's balloons, where they are known already.
        laws: User-defined laws beside the built-in ones.
        films: Shear moduli of film that was planned already [Pa], by number of the balloon: no bound is asked there.

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
    scene = resolve_self_contact(scene, shapes)
    held = [held_particle(number, string, scene, shapes) for number, string in enumerate(scene.string)]
    said = vary_parameters(parameters_at(scene, rows, 0), scene, rows, world_count, vary or {})
    bodies = [shape_body(number, body, scene) for number, body in enumerate(scene.body)]
    changes = list(due_changes(scene, rows))
    uncut, exact = Network(shapes, held, (*LAWS, *laws), bodies), said[SHEAR_MODULUS.name]
    parameters = _settled(scene, uncut, said, changes, vary or {}, films=films)
    shapes = cut_to_size(scene, shapes, parameters, exact)
    obstacles = [shape_obstacle(number, obstacle, scene) for number, obstacle in enumerate(scene.obstacle)]
    parameters |= resolve_bodies(scene, bodies, parameters)
    if obstacles:
        from balloon_warp.model.clearance import require_no_overlap_at_start  # takes long to load

        require_no_overlap_at_start(scene, shapes, obstacles, parameters)
    if bodies:
        from balloon_warp.model.clearance import require_no_overlap_of_bodies  # takes long to load

        require_no_overlap_of_bodies(scene, shapes, obstacles, bodies, parameters)
    ridges = all_ridges(scene, shapes, obstacles, bodies)
    if ridges and obstacles:
        from balloon_warp.model.clearance import exposed_ridges  # takes long to load

        ridges = exposed_ridges(scene, obstacles, ridges, parameters, changes, kept_distance(shapes))
    network = replace(uncut, shapes=shapes)
    substeps = substeps_over_time(scene, network, parameters, changes, start_velocities(shapes, parameters))
    if scene.substeps == "auto":
        substeps = max(substeps, substeps_of_solids(scene, bodies, parameters))
    bound = _strain_bound(scene, uncut, parameters, exact, changes, substeps)
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


def resolved_parameters(plan: ModelPlan, vary: Vary) -> Parameters:
    """Return the parameters that a plan of the same shapes has where other values vary, not rounded as devices do.

    Raises:
        InputError: as `plan_model`, where a value is wrong.
    """
    rows = rows_of(plan.laws)
    said = vary_parameters(parameters_at(plan.scene, rows, 0), plan.scene, rows, plan.world_count, vary)
    network = Network(plan.shapes, plan.held, plan.laws, plan.bodies)
    return _settled(plan.scene, network, said, plan.due_changes, vary, rounded=False)


def _settled(
    scene: Scene,
    network: Network,
    said: Mapping[str, NDArray[np.float64]],
    changes: Sequence[DueChange],
    varied: Collection[str],
    rounded: bool = True,
    films: Mapping[int, float] | None = None,
) -> Parameters:
    """Return the parameters with those that follow from them and from the shapes.

    They are the balloons' starting places, string lengths, "auto" pressures, moduli of film, and amounts of gas.

    Raises:
        InputError: a balloon cannot hold gas, or let it out so, is too far away for float32, or cannot be turned so.
    """
    shapes, held = network.shapes, network.held
    for balloon, shape in zip(scene.balloon, shapes, strict=True):
        if balloon.inflation.kind == "gas":
            require_sealed(shape)
    parameters = dict(said) | {"mass": resolve_masses(scene, shapes, dict(said))}
    parameters |= resolve_starts(scene, shapes, parameters)
    for name in ("initial_balloon_positions", "initial_rotations"):
        del parameters[name]
    for number, particle in enumerate(held):
        require_same_extreme(scene, parameters, number, shapes[scene.string[number].balloon], particle)
    parameters["string_length"] = string_lengths(scene, shapes, network.bodies, held, parameters)
    require_openings(scene, shapes, parameters)
    require_profile(parameters)
    parameters["keyframe_values"] = resolve_pressure(scene, shapes, parameters)
    parameters[SHEAR_MODULUS.name] = bounded_moduli(scene, shapes, parameters, changes, varied, films)
    parameters |= resolve_touch(scene, shapes, parameters) | resolve_friction(parameters, rounded)
    parameters |= resolve_tears(scene, parameters)
    parameters |= resolve_gas(scene, shapes, parameters, rounded)
    return parameters | {EVENED.name: resolve_bearing(scene, shapes, parameters)}


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
        update_dependents(turn.scene, network.shapes, values, then)
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


KINDS = ("normal_force", "pressure", "gas")
"""Kinds of inflation, as the kernels number them"""
DTYPES: dict[str, Any] = {
    **dict.fromkeys(
        ("initial_sphere_positions", "initial_sphere_velocities", "initial_sphere_spins", "initial_spins"), wp.vec3
    ),
    **dict.fromkeys(("initial_velocities", "string_anchor", "obstacle_position", "force_newtons"), wp.vec3),
    **dict.fromkeys(("initial_body_positions", "initial_body_velocities", "initial_body_spins"), wp.vec3),
    **dict.fromkeys(("initial_shifts", "initial_centers"), wp.vec3d),
    "initial_turns": wp.mat33d,
    "initial_loads": wp.vec2,
    **dict.fromkeys(("initial_gas_amounts", "initial_free_volumes"), wp.float64),
}
"""Types of the parameters that no law has; others are float32"""


def build_model(
    scene: Scene,
    device: str | wp.Device | None = None,
    world_count: int = 1,
    vary: Vary | None = None,
    laws: Sequence[Law] = (),
) -> Model:
    """Read the scene's meshes, string them, and lay everything out on the device.

    Raises:
        InputError: as `plan_model`.
    """
    device = pick_device(device)
    begin_driver(str(device))
    begin_loading(place_balloons, device)
    return lay_out(plan_model(scene, world_count, vary, laws=laws), device)


def lay_out(plan: ModelPlan, device: str | wp.Device | None = None) -> Model:
    """Return the planned model on a device. Large arrays are in states and schedules."""
    device = pick_device(device)
    scene, shapes = plan.scene, plan.shapes
    offsets = np.cumsum([0] + [shape.mesh.vertex_count for shape in shapes])

    def array(data: ArrayLike, dtype: Any) -> Any:
        return wp.array(np.asarray(data), dtype=dtype, device=device)

    def joined(parts: Sequence[ArrayLike], dtype: Any) -> Any:
        return array(np.concatenate([np.asarray(part) for part in parts]), dtype)

    def of_particles(parts: Sequence[NDArray[Any]], dtype: Any) -> Any:
        """Join arrays that number the particles of each balloon from 0."""
        return joined([part + offset for part, offset in zip(parts, offsets, strict=False)], dtype)

    skins = [shape.skin for shape in shapes]
    face_sizes = np.concatenate([skin.face_vertex_counts for skin in skins])
    face_particles = np.concatenate(
        [skin.face_vertex_indices + offset for skin, offset in zip(skins, offsets, strict=False)]
    )
    incidence_offsets, incident_faces = _faces_around_particles(face_sizes, face_particles, int(offsets[-1]))
    columns = all_columns(plan.laws)
    packed = pack(columns, plan.parameters, device)
    views = views_of(columns, **packed)
    others = {
        name: _items(values, DTYPES.get(name, wp.float32), device)
        for name, values in plan.parameters.items()
        if name not in views
    }
    return Model(
        scene=scene,
        shapes=shapes,
        particle_offsets=offsets.tolist(),
        device=device,
        world_count=plan.world_count,
        substeps=plan.substeps,
        due_changes=plan.due_changes,
        laws=plan.laws,
        warnings=plan.warnings,
        strain_bound=plan.strain_bound,
        frame_seconds=1.0 / scene.frames_per_second,
        up=wp.vec3(*scene.up),
        initial_points=array(np.concatenate([shape.mesh.points for shape in shapes]), wp.vec3d),
        balloon_origins=array([balloon.position for balloon in scene.balloon], wp.vec3d),
        particle_balloon=array(np.repeat(np.arange(len(shapes)), np.diff(offsets)), wp.int32),
        particle_mass_share=joined([shape.mass_share for shape in shapes], float),
        particle_face_offsets=array(incidence_offsets, wp.int32),
        particle_faces=array(incident_faces, wp.int32),
        face_offsets=array(np.cumsum(np.append(0, face_sizes)), wp.int32),
        face_particles=array(face_particles, wp.int32),
        face_balloon=array(np.repeat(np.arange(len(shapes)), [shape.mesh.face_count for shape in shapes]), wp.int32),
        spring_particles=of_particles([shape.springs.pairs for shape in shapes], wp.vec2i),
        spring_kind=joined([shape.springs.kind for shape in shapes], wp.int32),
        spring_rest_length=joined([shape.springs.rest_lengths for shape in shapes], float),
        spring_stiffness_scale=joined([shape.stiffness_scale for shape in shapes], float),
        membrane_corners=of_particles([shape.membrane.corners for shape in shapes], wp.vec3i),
        membrane_rests=joined([shape.membrane.rests for shape in shapes], wp.vec4),
        keyframe_times=array(_keyframe_times(scene), float),
        inflation_kind=array([KINDS.index(balloon.inflation.kind) for balloon in scene.balloon], wp.int32),
        tube_balloons=array(np.array([tube.balloons for tube in scene.tube]).reshape(-1, 2), wp.vec2i),
        neck_weights=joined(_neck_weights(shapes), float),
        neck_offsets=array(np.cumsum([0, *(len(shape.neck.edges) for shape in shapes)]), wp.int32),
        neck_edges=of_particles([shape.neck.edges for shape in shapes], wp.vec2i),
        string_particle=array([p + offsets[s.balloon] for s, p in zip(scene.string, plan.held, strict=True)], wp.int32),
        **_carried(Carriers.of(scene, plan.bodies), device),
        driven=plan.driven,
        obstacles=plan.obstacles,
        obstacle_meshes=[warp_mesh(shape, device) for shape in plan.obstacles],
        bodies=plan.bodies,
        body_meshes=[warp_mesh(shape.solid, device) for shape in plan.bodies],
        ridges=plan.ridges,
        ridge_trees=[ridge_tree(ridges, device) for ridges in plan.ridges],
        obstacle_motion=_items(obstacle_motion(scene), wp.transform, device),
        columns=columns,
        balloon_numbers=packed["balloon_numbers"],
        sphere_numbers=packed["sphere_numbers"],
        world_numbers=packed["world_numbers"],
        parameters={**views, **others},
    )


def _carried(carriers: Carriers, device: wp.Device) -> dict[str, Any]:
    """Return the carriers of strings' anchors, on the host and as arrays."""
    numbers = np.stack([carriers.obstacles, carriers.bodies], axis=1)
    return {
        "carriers": carriers,
        "string_carriers": wp.array(numbers, dtype=wp.vec2i, device=device),
        "string_centers": wp.array(carriers.centers, dtype=wp.vec3, device=device),
        "anchor_motion": _items(carriers.motion, wp.transform, device),
    }


def _neck_weights(shapes: Sequence[BalloonShape]) -> list[NDArray[np.float64]]:
    """Return the neck weights of all particles, or of none where no balloon has a neck."""
    if not any(len(shape.neck.edges) for shape in shapes):
        return [np.zeros(0)]
    return [shape.neck.weights if len(shape.neck.edges) else np.zeros(shape.mesh.vertex_count) for shape in shapes]


def _items(values: NDArray[np.float64], dtype: Any, device: wp.Device) -> wp.array:
    """Return an array of numbers, of vectors of the last dimension, or of matrices of the last two."""
    if dtype in (wp.float32, wp.float64, wp.mat33d):
        return wp.array(values, dtype=dtype, device=device)
    flat = values.reshape(-1, values.shape[-1])  # Warp does not tell an empty array's last dimension
    return wp.array(flat, dtype=dtype, device=device).reshape(values.shape[:-1])


def _keyframe_times(scene: Scene) -> NDArray[np.float64]:
    """Return the times of all keyframes, shape (balloon_count, keyframe_count), padded by the last."""
    lists = [[time for time, _ in balloon.inflation.keyframes] for balloon in scene.balloon]
    longest = max(len(times) for times in lists)
    return np.array([times + times[-1:] * (longest - len(times)) for times in lists])


def _faces_around_particles(
    face_sizes: NDArray[np.int32], face_particles: NDArray[np.int32], particle_count: int
) -> tuple[NDArray[np.integer], NDArray[np.integer]]:
    """Return the faces of each particle, as offsets and a flat list.

    A face that passes a particle twice counts once.
    """
    faces = np.repeat(np.arange(len(face_sizes)), face_sizes)
    pairs = np.unique(np.stack([face_particles, faces], axis=1), axis=0)
    return np.searchsorted(pairs[:, 0], np.arange(particle_count + 1)), pairs[:, 1]
