"""Tables of strings and outer forces for kernels."""

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.frames.around import move_anchors
from balloon_warp.kernels.outer_tables import ForceTable, StringTable
from balloon_warp.launching import launch
from balloon_warp.model import Model, State
from balloon_warp.model.rows import VELOCITY
from balloon_warp.model.state import frames_of


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
