"""A model as kernels take it: its features, and tables of balloons, obstacles, strings and outer forces."""

from collections.abc import Sequence
from operator import is_
from typing import Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.frame import air_kernel, move_anchors, note_given_loads, place_fixtures, ramp_inflation
from balloon_warp.kernels.laws.air import VARYING
from balloon_warp.kernels.laws.contact import SHAPES
from balloon_warp.kernels.laws.outer import GAS, NORMAL_FORCE
from balloon_warp.kernels.laws.springs import HOOKE, RUBBER, RUBBER_AT_LIMIT
from balloon_warp.kernels.schedules.launched import GATHERED
from balloon_warp.kernels.tables import (
    CHUNK,
    BodyTable,
    CorrectionTable,
    FaceTable,
    FanTable,
    FixtureTable,
    ForceTable,
    HingeTable,
    NeckTable,
    PairTable,
    PumpTable,
    Solid,
    SphereTable,
    SpringTable,
    StringTable,
    Tables,
    TubeTable,
    WorldState,
)
from balloon_warp.mesh.orientation import triangles_of
from balloon_warp.model import Model, State
from balloon_warp.model.obstacles import FRICTION, ObstacleShape, sample
from balloon_warp.model.parameters import VELOCITY, active_laws, active_phases, kept_values, values_over_time
from balloon_warp.model.pressure import pressure_bounds
from balloon_warp.model.starts import inside_volume, may_be_crushed
from balloon_warp.model.state import Allocating, Room, frames_of
from balloon_warp.model.touch import edges_meet
from balloon_warp.schedules.frames import health_table
from balloon_warp.schedules.membranes import membrane_laws, membrane_table, membranes_of_world
from balloon_warp.schedules.slices import SpringEnds, particle_table, quad_rings, ring_table, slices_of, spring_ends
from balloon_warp.schedules.touch_table import ridge_table, round_ridges, small_spheres, touch_table
from balloon_warp.springs.build import color_springs
from balloon_warp.system.warp_threads import launch

FILLS = ("fill_breaths", "fill_litres", "fill_moles", "fill_to_pressure", "fill_to_diameter")
"""Parameters of fills that need more than a pump"""
FINITE_AT_NO_LENGTH = (HOOKE, RUBBER, RUBBER_AT_LIMIT)
"""Laws of springs whose force is zero at zero length; any other may give NaN for a spring from a particle to itself"""
CHOOSE_FEATURES = frozenset(
    {"breathing_damping", "added_mass", "leak", "neck_diameter", "sphere_friction", "force_newtons", *VARYING, *FILLS}
)
"""Parameters that kernels are chosen by, and that replace them when they change"""


def choosing_parameters(features: Features) -> frozenset[str]:
    """Return the parameters that kernels are chosen by, and that replace them when they change.

    Once gas is pumped, it may stop and begin again.
    """
    may_begin = (features.gas and not features.pumps) or (features.pressures and not features.crushes)
    return CHOOSE_FEATURES | ({"keyframe_values"} if may_begin else frozenset())


def model_features(model: Model) -> Features:
    """Return the features of a model's kernels."""
    kinds = {int(kind) for kind in model.inflation_kind.numpy()}
    scene = model.scene
    laws = active_laws(model)
    viscosities = values_over_time(model, "film_viscosity")
    crushes = may_be_crushed(scene, model.shapes, list(values_over_time(model, "keyframe_values")))
    features = Features(
        laws=laws,
        columns=model.columns,
        active=tuple(phase.name for phase in active_phases(model)),
        keeps=kept_values(model),
        membranes=membrane_laws(model),
        viscous=any(values.any() for values in viscosities),
        softens=model.softens,
        bursts=model.bursts,
        balloons=model.balloon_count,
        spheres=model.sphere_count,
        springs_vary=bool((model.spring_stiffness_scale.numpy() != 1.0).any()),
        quads=bool((np.diff(model.face_offsets.numpy()) == 4).all()),
        revisits=len(model.particle_faces) < len(model.face_particles),
        rings=quad_rings(model) is not None and not model.bursts,  # holes are faces of their own
        guarded=any(law.kind == "spring" and law not in FINITE_AT_NO_LENGTH for law in laws),
        inflation_directions=int(NORMAL_FORCE) in kinds,
        pressures=kinds != {int(NORMAL_FORCE)},
        gas=int(GAS) in kinds or model.bursts or crushes,
        crushes=crushes,
        air_varies=_air_varies(model),
        takes_air_along=int(GAS) in kinds and _takes_air_along(model),
        breathes_on=int(GAS) in kinds and scene.solver != "forward_euler" and _breathes_on(model),
        pumps=int(GAS) in kinds and (_has_pumps(model) or _fills(model)),
        fills=_fills(model),
        tubes=model.tube_count > 0,
        vents=_ever(model, "neck_diameter") or _ever(model, "leak") or model.bursts,
        jets=_ever(model, "neck_diameter"),
        fresh_normals=scene.normals == "fresh" and int(NORMAL_FORCE) in kinds,
        corrected=scene.correction != "none",
        driven=_ever(model, "force_newtons"),
        forward_euler=scene.solver == "forward_euler",
        impulses=scene.contact == "impulse" and model.sphere_count > 0,
        spheres_rub=model.sphere_count > 0 and _ever(model, "sphere_friction"),
        small_spheres=any(small_spheres(model)),
        ground=scene.ground is not None,
        fixtures=bool(scene.obstacle),
        fixture_meshes=any(obstacle.shape == "mesh" for obstacle in scene.obstacle),
        anchors_move=model.anchor_motion.shape[0] > 1,
        ties=any(string.body is not None for string in scene.string),
        fixtures_move=model.obstacle_motion.shape[0] > 1,
        fixtures_steered=model.is_steered,
        bodies=model.body_count,
        body_meshes=any(body.shape == "mesh" for body in scene.body),
        tells_contacts=scene.contacts,
        ridges=model.faces_meet or any(round_ridges(model)),
        round_ridges=any(round_ridges(model)),
        touches=scene.touches,
        touches_itself=scene.touches_itself,
        edges_meet=edges_meet(scene, model.shapes),
    )
    changed = {
        name
        for phase in active_phases(model)
        if phase.is_active(features)
        for name in phase.changes(features, GATHERED)
    }
    return features._replace(changes=tuple(sorted(changed)))


def _has_pumps(model: Model) -> bool:
    """Return whether gas is pumped, in any world at any time, or may be by changes."""
    at_start, *changed = values_over_time(model, "keyframe_values")
    of_gas = model.inflation_kind.numpy() == int(GAS)
    return bool(at_start[:, of_gas].any()) or any(values.any() for values in changed)


def _takes_air_along(model: Model) -> bool:
    """Return whether a balloon with gas has added mass, in any world at any time."""
    at_start, *changed = values_over_time(model, "added_mass")
    of_gas = model.inflation_kind.numpy() == int(GAS)
    return bool(at_start[:, of_gas].any()) or any(values.any() for values in changed)


def _air_varies(model: Model) -> bool:
    """Return whether the air differs from place to place, in any world at any time."""
    return any(
        (values != np.float32(alike)).any()
        for name, alike in VARYING.items()
        for values in values_over_time(model, name)
    )


def _fills(model: Model) -> bool:
    """Return whether a balloon is filled by more than a pump."""
    curves = any(balloon.inflation.pump_curve for balloon in model.scene.balloon)
    return curves or any(_ever(model, name) for name in FILLS)


def _ever(model: Model, name: str) -> bool:
    """Return whether a parameter is not 0 in any world at any time."""
    return any(values.any() for values in values_over_time(model, name))


def _breathes_on(model: Model) -> bool:
    """Return whether a gas's breathing is damped less than by backward Euler, in any world at any time."""
    return any((values != 1.0).any() for values in values_over_time(model, "breathing_damping"))


def string_table(model: Model) -> Any:
    """Return a model's strings."""
    held = model.string_particle.numpy()
    order = np.argsort(held, kind="stable")
    offsets = np.searchsorted(held[order], np.arange(model.particle_count + 1)) if len(held) else []
    table = StringTable()
    table.offsets = _array(model, offsets, wp.int32)
    table.particles = _array(model, held[order], wp.int32)
    table.order = _array(model, np.stack([order, model.carriers.bodies[order]], axis=1), wp.vec2i)
    return _with_strings(table, model)


def place_anchors(model: Model, tables: Any, state: State) -> None:
    """Place the anchors that move as the frame that begins has them, in each world by its own time."""
    table = tables.strings
    if model.anchor_motion.shape[0] > 1:
        steered = model.parameters[VELOCITY] if model.is_steered else table.anchors  # which is not read
        inputs = [
            model.anchor_motion, model.string_carriers, model.string_centers, model.parameters["string_anchor"],
            model.parameters["obstacle_position"], steered, int(model.is_steered), model.frame_seconds, state.frame,
            frames_of(model, state), state.body_positions, state.body_turns,
        ]  # fmt: skip
        launch(move_anchors, (model.world_count, model.string_count), inputs, [table.anchors], device=model.device)


def strings_of_world(model: Model, batch: Any) -> Any:
    """Return a batch's strings for one of its worlds, whose model has views of its parameters."""
    return _with_strings(_copied(batch, StringTable), model)


def _with_strings(table: Any, model: Model) -> Any:
    table.anchors = model.parameters["string_anchor"]
    if model.anchor_motion.shape[0] > 1:
        shape = (3 * model.world_count, model.string_count + 1)
        table.anchors = wp.zeros(shape, dtype=wp.vec3, device=model.device)
    table.lengths = model.parameters["string_length"]
    table.stiffness = model.parameters["string_stiffness"]
    return table


def force_table(model: Model, features: Features) -> Any:
    """Return a model's outer forces on each particle, where any may act."""
    table = ForceTable()
    table.slots = _array(model, _slots(model) if features.driven else np.zeros((0, 0)), float)
    table.newtons = model.parameters["force_newtons"]
    return table


def _slots(model: Model) -> NDArray[np.float64]:
    """Return each particle's shares in forces and the indices of these by turns, padded by 0."""
    driven = model.driven
    order = np.argsort(driven.particles, kind="stable")
    particles = driven.particles[order]
    nth = np.arange(len(particles)) - np.searchsorted(particles, particles)
    slots = np.zeros((model.particle_count, 2 * (nth.max(initial=0) + 1)))
    slots[particles, 2 * nth] = driven.shares[order]
    slots[particles, 2 * nth + 1] = driven.forces[order]
    return slots


def forces_of_world(model: Model, batch: Any) -> Any:
    """Return a batch's outer forces for one of its worlds, whose model has views of its parameters."""
    table = _copied(batch, ForceTable)
    table.newtons = model.parameters["force_newtons"]
    return table


def _copied(table: Any, kind: Any) -> Any:
    copied = kind()
    for name in kind.vars:
        setattr(copied, name, getattr(table, name))
    return copied


def _array(model: Model, values: Any, dtype: Any) -> wp.array:
    return wp.array(np.asarray(values), dtype=dtype, device=model.device)


NOWHERE = 1.0e18
"""Extent of something infinite [m], whose square is a float32"""


def fastest(motion: NDArray[np.floating], reaches: NDArray[np.floating], frame_seconds: float) -> float:
    """Return the largest speed of a point of any obstacle [m/s].

    Args:
        motion: Shifts and quaternions by frame, shape (frames, obstacle_count, 7).
        reaches: Extents of the obstacles [m], shape (obstacle_count,).
    """
    if len(motion) == 1 or not len(reaches):
        return 0.0
    shifts = np.linalg.norm(np.diff(motion[..., :3], axis=0), axis=-1)
    before, after = motion[:-1, :, 3:], motion[1:, :, 3:]
    halves = np.minimum(np.linalg.norm(after - before, axis=-1), np.linalg.norm(after + before, axis=-1))
    turns = 4.0 * np.arcsin(0.5 * halves.clip(max=2.0))
    return float(((shifts + turns * reaches).max()) / frame_seconds)


def fixture_table(model: Model) -> Any:
    """Return the obstacles of a model; Warp's meshes live as long as the model does."""
    table = FixtureTable()
    table.solids = solid_array(model.obstacles, model.obstacle_meshes, model.device)
    table.motion = model.obstacle_motion
    if _moves(model):
        rows = 2 if model.ages is None else 2 * model.world_count
        table.motion = wp.zeros((rows, len(model.obstacles)), dtype=wp.transform, device=model.device)
    table.positions = model.parameters["obstacle_position"]
    if model.is_steered:
        table.velocities = model.parameters[VELOCITY]
    table.restitutions = model.parameters["obstacle_restitution"]
    if model.bodies and model.obstacles:
        _put_samples(table, model)
    reaches = np.array([min(shape.reach, NOWHERE) for shape in model.obstacles])
    table.fastest = fastest(_floats(model.obstacle_motion), reaches, model.frame_seconds) + _steered_speed(model)
    table.clearances, table.nearest = clearance_arrays(model, Allocating(model.device))
    return table


def _moves(model: Model) -> bool:
    """Return whether any obstacle moves, by the scene or by controls."""
    return model.obstacle_motion.shape[0] > 1


def _steered_speed(model: Model) -> float:
    """Return the largest speed that controls may give an obstacle [m/s]."""
    rows = [np.abs(row).max(axis=0) for row in model.reach.get(VELOCITY, ())]
    return float(np.linalg.norm(np.max(rows, axis=0), axis=-1).max()) if rows else 0.0


def solid_array(shapes: Sequence[ObstacleShape], meshes: Sequence[wp.Mesh | None], device: wp.Device) -> wp.array:
    """Return the shapes, of which those that are meshes have one of Warp's."""
    solids = []
    for shape, mesh in zip(shapes, meshes, strict=True):
        solid = Solid()
        solid.kind, solid.closed = SHAPES.index(shape.kind), int(shape.closed)
        solid.size, solid.mesh = wp.vec3(shape.size), mesh.id if mesh else 0
        solid.thickness, solid.reach, solid.blur = shape.thickness, min(shape.reach, NOWHERE), shape.blur
        solids.append(solid)
    return wp.array(solids, dtype=Solid, device=device)


def _put_samples(table: Any, model: Model) -> None:
    up = np.array(model.scene.up)
    points = [sample(shape, up).points for shape in model.obstacles]
    ends = np.cumsum([0, *(len(its) for its in points)])
    table.samples = wp.array(np.concatenate(points), dtype=wp.vec4, device=model.device)
    table.sample_ends = wp.array(np.stack([ends[:-1], ends[1:]], axis=1), dtype=wp.vec2i, device=model.device)


def body_table(model: Model) -> Any:
    """Return the free bodies of a model; empty where there are none."""
    table = BodyTable()
    if not model.bodies:
        return table
    shapes, parameters = model.bodies, model.parameters
    inertias = np.array([shape.inertia for shape in shapes])
    table.solids = solid_array([shape.solid for shape in shapes], model.body_meshes, model.device)
    table.mass, table.restitution = parameters["body_mass"], parameters["body_restitution"]
    table.inertias = wp.array(inertias, dtype=wp.mat33, device=model.device)
    table.inverse_inertias = wp.array(np.linalg.inv(inertias), dtype=wp.mat33, device=model.device)
    samples = [shape.samples for shape in shapes]
    firsts = np.cumsum([0, *(len(its.points) for its in samples)])
    ends = [
        (first, first + its.outermost, first + its.at_edges, first + len(its.points))
        for first, its in zip(firsts, samples, strict=False)
    ]
    points = np.concatenate([its.points for its in samples])
    table.samples = wp.array(points, dtype=wp.vec4, device=model.device)
    table.sample_ends = wp.array(ends, dtype=wp.vec4i, device=model.device)
    return table


def _floats(array: wp.array) -> NDArray[np.float32]:
    return np.asarray(array.numpy(), dtype=np.float32)


def clearance_arrays(model: Model, room: Room) -> tuple[Any, Any]:
    """Return the memory for looks of particles at obstacles, if there are any, and for obstacles' numbers, if many."""
    seen, many = (model.particle_count if len(model.obstacles) > least else 0 for least in (0, 1))
    return room.array((model.world_count, seen), wp.vec4), room.array((model.world_count, many), wp.vec2)


def place_obstacles(model: Model, tables: Any, state: State) -> None:
    """Place obstacles as the frame that begins has them, in each world by its own time."""
    if _moves(model):
        placed, frames = tables.fixtures.motion, frames_of(model, state)
        shape = placed.shape[0] // 2, placed.shape[1]
        launch(place_fixtures, shape, [model.obstacle_motion, frames], [placed], device=model.device)


def clear_clearances(tables: Any) -> None:
    """Clear cached queries as a frame begins, since balloons and obstacles may have been moved."""
    if tables.fixtures.clearances.size:
        tables.fixtures.clearances.zero_()
    if tables.fixtures.nearest.size:
        tables.fixtures.nearest.zero_()


def make_tables(model: Model, features: Features, in_block: bool = False) -> Any:
    """Return all that does not change in a frame.

    Args:
        in_block: for the `block` schedule, see `ring_table`.
    """
    t = Tables()
    t.particles = particle_table(model)
    ends = spring_ends(model)
    t.springs = _springs(model, features, ends)
    ring = quad_rings(model) if features.rings else None
    t.rings = ring_table(model, ends, ring, features.springs_vary, in_block)
    t.pairs = _pairs(model)
    t.hinges = _hinges(model, features)
    t.membranes = membrane_table(model)
    t.strings, t.outer = string_table(model), force_table(model, features)
    t.faces = _faces(model)
    t.fans = _fans(model, features)
    t.spheres = _spheres(model)
    if features.small_spheres:
        triangles = [triangles_of(s.mesh) + n for s, n in zip(model.shapes, model.particle_offsets, strict=False)]
        t.spheres.small = _array(model, small_spheres(model), wp.int32)
        t.spheres.triangles = _array(model, np.concatenate(triangles), wp.vec3i)
    t.fixtures, t.bodies = fixture_table(model), body_table(model)
    t.tubes, t.pumps, t.necks = _tubes(model), _pumps(model), _necks(model)
    t.touch = touch_table(model, features)
    t.ridges = ridge_table(model, features)
    t.correction = _correction(model, features)
    t.health = health_table(model)
    t.balloon_numbers, t.world_numbers = model.balloon_numbers, model.world_numbers
    t.friction = model.parameters[FRICTION]
    t.inflation_kind, t.up = model.inflation_kind, model.up
    t.substeps, t.step_seconds, t.frame_seconds = model.substeps, model.step_seconds, model.frame_seconds
    return t


def tables_of_world(model: Model, tables: Any) -> Any:
    """Return a batch's tables for one of its worlds, whose model has views of its parameters."""
    t = Tables()
    for name in Tables.vars:
        setattr(t, name, getattr(tables, name))
    t.membranes = membranes_of_world(model, tables.membranes)
    t.strings, t.outer = strings_of_world(model, tables.strings), forces_of_world(model, tables.outer)
    t.spheres, t.tubes = _spheres(model), _tubes(model)
    t.spheres.small, t.spheres.triangles = tables.spheres.small, tables.spheres.triangles
    t.fixtures, t.bodies = tables.fixtures, body_table(model)
    t.balloon_numbers, t.world_numbers = model.balloon_numbers, model.world_numbers
    t.friction = model.parameters[FRICTION]
    return t


def world_state(state: State) -> Any:
    """Return the arrays of a state."""
    worlds = WorldState()
    for name in WorldState.vars:
        setattr(worlds, name, getattr(state, name))
    return worlds


class Worlds:
    """Arrays of a state as kernels take them, made once for a state: that takes longer than a launch."""

    def __init__(self) -> None:
        self._arrays: list[wp.array] = []
        self._worlds: Any = None

    def of(self, state: State) -> Any:
        """Return the arrays of a state, as `world_state` does."""
        arrays = [getattr(state, name) for name in WorldState.vars]
        if len(self._arrays) != len(arrays) or not all(map(is_, arrays, self._arrays)):
            self._arrays, self._worlds = arrays, world_state(state)
        return self._worlds


def kept_arguments(state: State) -> dict[str, wp.array]:
    """Return the arguments of kernels that hold the state of items."""
    return {f"kept_{name}": array for name, array in state.kept.items()}


def _springs(model: Model, features: Features, ends: SpringEnds) -> Any:
    table = SpringTable()
    valences = ends.by_kind.sum(axis=1)
    slices = slices_of(ends.particle, valences, CHUNK)
    packed = 4 * slices.owners.astype(np.int32)  # padding is a spring from the particle to itself
    packed[slices.places] = 4 * ends.neighbor + ends.kind
    lengths, scales = np.zeros((2, len(packed)), dtype=np.float32)
    lengths[slices.places], scales[slices.places] = ends.rest_length, ends.scale
    table.slice_offsets = _array(model, slices.offsets, wp.int32)
    table.valences = _array(model, valences, wp.int32)
    table.entries = _array(model, np.stack([packed.view(np.float32), lengths], axis=1), wp.vec2)
    table.scales = _array(model, scales if features.springs_vary else [], float)
    return table


def _pairs(model: Model) -> Any:
    table = PairTable()
    table.particles, table.kinds = model.spring_particles, model.spring_kind
    table.scales, table.rest_lengths = model.spring_stiffness_scale, model.spring_rest_length
    return table


def _hinges(model: Model, features: Features) -> Any:
    """Return the hinges of balloons, where a law acts on them, and the roles of each particle in them."""
    hinges = [shape.hinges for shape in model.shapes] if features.has("hinge") else []
    offsets = model.particle_offsets[:-1]
    empty = np.zeros(0, dtype=np.int64)
    ends = np.concatenate([empty.reshape(0, 2), *(h.ends + first for h, first in zip(hinges, offsets, strict=False))])
    wings = np.concatenate([empty, *(h.wing_particles + first for h, first in zip(hinges, offsets, strict=False))])
    sizes = np.concatenate([empty, *(h.wing_sizes.ravel() for h in hinges)])
    numbers = np.arange(len(ends))
    particles = np.concatenate([ends[:, 0], ends[:, 1], wings])
    of_wings = np.stack([4 * numbers + 2, 4 * numbers + 3], axis=1).ravel()
    roles = np.concatenate([4 * numbers, 4 * numbers + 1, np.repeat(of_wings, sizes)])
    order = np.lexsort([roles, particles])
    angles = [h.angles(shape.mesh.points) for h, shape in zip(hinges, model.shapes, strict=False)]
    table = HingeTable()
    table.ends = _array(model, ends, wp.vec2i)
    table.wing_offsets = _array(model, np.cumsum(np.append(0, sizes)), wp.int32)
    table.wing_particles = _array(model, wings, wp.int32)
    table.rest_angles = _array(model, np.concatenate([np.zeros(0), *angles]), float)
    starts = np.searchsorted(particles[order], np.arange(model.particle_count + 1))
    table.particle_offsets = _array(model, starts, wp.int32)
    table.particle_roles = _array(model, roles[order], wp.int32)
    return table


def _faces(model: Model) -> Any:
    table = FaceTable()
    table.offsets, table.particles, table.balloon = model.face_offsets, model.face_particles, model.face_balloon
    counts = [shape.mesh.face_count for shape in model.shapes]
    table.balloon_offsets = _array(model, np.cumsum([0, *counts]), wp.int32)
    table.volume_origins = _array(model, volume_origins(model), wp.int32)
    volumes = [inside_volume(shape) for shape in model.shapes]
    bounds = pressure_bounds(model.scene, model.shapes)
    table.enclosed = _array(model, np.stack([volumes, bounds], axis=1), wp.vec2)
    table.particle_offsets, table.around_particles = model.particle_face_offsets, model.particle_faces
    return table


def volume_origins(model: Model) -> NDArray[np.int64]:
    """Return the particle of each balloon about which its volume is taken: one of a face, shape (balloon_count,)."""
    first_faces = np.searchsorted(model.face_balloon.numpy(), np.arange(model.balloon_count))
    corners = np.asarray(model.face_offsets.numpy(), dtype=np.int64)[first_faces]
    return np.append(np.asarray(model.face_particles.numpy(), dtype=np.int64), 0)[corners]


class OtherCorners(NamedTuple):
    """Other corners of the face at every corner of a face, sorted by particle."""

    particles: NDArray[np.int64]
    """Particle of the corner itself, shape (corner_count,)"""
    sizes: NDArray[np.int64]
    """Number of other corners, shape (corner_count,)"""
    begins: NDArray[np.int64]
    """Begin of the other corners, and the end of the last, shape (corner_count + 1,)"""
    others: NDArray[np.int64]
    """Particles of the other corners in order from the corner, one corner's after the other"""


def other_corners(model: Model) -> OtherCorners:
    """Return the corners that each corner of a face has beside it."""
    particles = np.asarray(model.face_particles.numpy(), dtype=np.int64)
    offsets = np.asarray(model.face_offsets.numpy(), dtype=np.int64)
    counts, order = np.diff(offsets), np.argsort(particles, kind="stable")
    first, count = (np.repeat(each, counts)[order] for each in (offsets[:-1], counts))
    begins = np.append(0, np.cumsum(count - 1))
    corner = np.repeat(np.arange(len(particles)), count - 1)
    onward = np.arange(begins[-1]) - begins[corner] + 1
    others = particles[first[corner] + (order[corner] - first[corner] + onward) % count[corner]]
    return OtherCorners(particles[order], count - 1, begins, others)


def quads_at_particles(model: Model) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the corners of quads, sorted by particle: the particle, and the corners before, opposite and after.

    The latter have shape (corner_count, 3).
    """
    corners = np.asarray(model.face_particles.numpy(), dtype=np.int64).reshape(-1, 4)
    each = np.stack([np.roll(corners, -turn, axis=1) for turn in range(4)], axis=1).reshape(-1, 4)
    each = each[np.argsort(each[:, 0], kind="stable")]
    return each[:, 0], each[:, [3, 2, 1]]


def _fans(model: Model, features: Features) -> Any:
    """Return the corners of faces at each particle, where area vectors are needed."""
    table = FanTable()
    count = model.particle_count
    if features.measures_areas and features.quads:
        particles, others = quads_at_particles(model)
        counts = np.bincount(particles, minlength=count)
        slices = slices_of(particles, counts, 1)
        quads = np.repeat(slices.owners[:, None], 3, axis=1)
        quads[slices.places] = others
        table.slice_offsets = _array(model, slices.offsets, wp.int32)
        table.counts = _array(model, counts, wp.int32)
        table.quads = _array(model, quads, wp.vec3i)
    elif features.measures_areas:
        fans = other_corners(model)
        table.offsets = _array(model, np.searchsorted(fans.particles, np.arange(count + 1)), wp.int32)
        table.begins, table.particles = _array(model, fans.begins, wp.int32), _array(model, fans.others, wp.int32)
    return table


def _spheres(model: Model) -> Any:
    table = SphereTable()
    table.numbers = model.sphere_numbers
    return table


def _tubes(model: Model) -> Any:
    table = TubeTable()
    table.balloons, table.conductance = model.tube_balloons, model.parameters["tube_conductance"]
    return table


def _pumps(model: Model) -> Any:
    """Return the pump curves; balloons without one have a point without flow."""
    curves = [balloon.inflation.pump_curve or [(0.0, 0.0)] for balloon in model.scene.balloon]
    longest = max(map(len, curves))
    points = np.array([[*curve, *curve[-1:] * (longest - len(curve))] for curve in curves])
    table = PumpTable()
    table.has = _array(model, [bool(balloon.inflation.pump_curve) for balloon in model.scene.balloon], wp.int32)
    table.pressures, table.flows = _array(model, points[..., 0], float), _array(model, points[..., 1], float)
    return table


def _necks(model: Model) -> Any:
    table = NeckTable()
    table.weights, table.offsets, table.edges = model.neck_weights, model.neck_offsets, model.neck_edges
    return table


def _correction(model: Model, features: Features) -> Any:
    """Return the springs color by color; none where lengths are not corrected."""
    pairs = np.asarray(model.spring_particles.numpy(), dtype=np.int64).reshape(-1, 2)
    pairs = pairs[: None if features.corrected else 0]
    colors = color_springs(pairs, np.concatenate([shape.mesh.points for shape in model.shapes]))
    order = np.lexsort([pairs[:, 1], pairs[:, 0], colors])
    table = CorrectionTable()
    table.color_offsets = _array(model, np.append(0, np.cumsum(np.bincount(colors))), wp.int32)
    table.particles = _array(model, pairs[order], wp.vec2i)
    table.rest_lengths = _array(model, model.spring_rest_length.numpy()[order], float)
    table.sweeps = model.scene.correction_sweeps
    return table


def refresh_ramp(model: Model, state: State) -> None:
    """Update the inflation coefficients of the frame that begins."""
    launch(
        ramp_inflation,
        (model.world_count, model.balloon_count),
        inputs=[
            *(model.keyframe_times, model.parameters["keyframe_values"], model.frame_seconds),
            frames_of(model, state),
        ],
        outputs=[state.inflation_ramp],
        device=model.device,
    )


def update_air(model: Model, features: Features, tables: Any, state: State, numbers: wp.array | None = None) -> None:
    """Update the air at balloons, and the added mass, for the frame that begins.

    Args:
        numbers: of particles in the state, if tables have them in another order.
    """
    if features.takes_air_along or features.gas_meets_air:
        places = model.world_count, model.balloon_count
        launch(air_kernel(features), places, inputs=[tables, numbers, world_state(state)], device=model.device)


def note_pressures(model: Model, features: Features, state: State) -> None:
    """Store the given pressures of the last substep."""
    if features.pressures and not features.gas:
        time = (model.substeps - 1) * model.step_seconds
        inputs = [model.inflation_kind, time, world_state(state)]
        launch(note_given_loads, (model.world_count, model.balloon_count), inputs=inputs, device=model.device)
