"""Tables of obstacles for kernels."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.kernels.contact_tables import BodyTable, FixtureTable, Solid
from balloon_warp.kernels.frames.around import place_fixtures
from balloon_warp.kernels.laws.fixture import SHAPES
from balloon_warp.launching import launch
from balloon_warp.model import Model, State
from balloon_warp.model.body_samples import sample
from balloon_warp.model.memory import Allocating, Room
from balloon_warp.model.obstacles import ObstacleShape
from balloon_warp.model.rows import VELOCITY
from balloon_warp.model.state import frames_of

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
    table.looks, table.nearest = look_arrays(model, Allocating(model.device))
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
    table.eases = wp.array(np.linalg.inv(inertias), dtype=wp.mat33, device=model.device)
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


def look_arrays(model: Model, room: Room) -> tuple[Any, Any]:
    """Return the memory for looks of particles at obstacles, if there are any, and for obstacles' numbers, if many."""
    seen, many = (model.particle_count if len(model.obstacles) > least else 0 for least in (0, 1))
    return room.array((model.world_count, seen), wp.vec4), room.array((model.world_count, many), wp.vec2)


def place_obstacles(model: Model, tables: Any, state: State) -> None:
    """Place obstacles as the frame that begins has them, in each world by its own time."""
    if _moves(model):
        placed, frames = tables.fixtures.motion, frames_of(model, state)
        shape = placed.shape[0] // 2, placed.shape[1]
        launch(place_fixtures, shape, [model.obstacle_motion, frames], [placed], device=model.device)


def forget_looks(tables: Any) -> None:
    """Clear cached queries as a frame begins, since balloons and obstacles may have been moved."""
    if tables.fixtures.looks.size:
        tables.fixtures.looks.zero_()
    if tables.fixtures.nearest.size:
        tables.fixtures.nearest.zero_()
