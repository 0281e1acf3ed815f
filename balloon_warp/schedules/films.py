"""Membranes as blocks go through them: face by face."""

from typing import Any

import numpy as np
import warp as wp

from balloon_warp.kernels.film_tables import FilmTable
from balloon_warp.kernels.schedules.block_memory import FilmLayout
from balloon_warp.kernels.schedules.film_places import PLACE_BYTES, VECTOR_BYTES
from balloon_warp.kernels.traits import Traits
from balloon_warp.model import Model
from balloon_warp.schedules.film_banks import spread_places, turned_quads
from balloon_warp.schedules.membranes import MembraneQuads, membrane_quads

MOST_FACES = 12
"""at a particle: where there are more, most particles would wait for the few"""


def film_layout(model: Model, traits: Traits) -> FilmLayout | None:
    """How; None where there are no membranes, or too many faces at a particle, or springs that give more on the way
    around a particle."""
    if not traits.membranes or traits.rings:
        return None
    quads = membrane_quads(model)
    most = int(np.bincount(_particles_and_places(quads)[0]).max())
    if most > MOST_FACES:
        return None
    triangles = int(quads.triangles.max())
    mixed = bool(quads.triangles.min() < triangles)
    corners = np.diff(model.face_offsets.numpy())
    all_there = len(quads.corners) == model.face_count and (corners == (4 if triangles == 4 else 3)).all()
    return FilmLayout(most, triangles, mixed, bool(traits.measures_areas and all_there and not mixed))


def film_table(model: Model, layout: FilmLayout | None, resident: bool) -> Any:
    """For the layout; empty without one.

    Args:
        resident: whether particles stay in registers.
    """
    table = FilmTable()
    if layout is None:
        return table
    quads = membrane_quads(model)
    if resident and layout.triangles == 4 and not layout.mixed:
        quads = turned_quads(quads, model.particle_count)
    particles, places = _particles_and_places(quads, layout.held)
    counts = np.bincount(particles, minlength=model.particle_count)
    slot = np.arange(len(particles)) - np.repeat(np.cumsum(counts) - counts, counts)
    fours, nothing = -(-layout.slots // 4), film_entries(model, layout.held) - 1
    in_slots = np.full((4 * fours, model.particle_count), -1)
    in_slots[slot, particles] = places
    if resident:
        in_slots[: layout.slots] = spread_places(in_slots[: layout.slots])
    of_slots = np.where(in_slots < 0, nothing, in_slots).reshape(fours, 4, -1).swapaxes(1, 2)
    rests = (shapes_of(quads) if layout.held else quads.rests).transpose(1, 0, 2).reshape(-1, 4)
    table.corners = wp.array((VECTOR_BYTES if resident else 1) * quads.corners, dtype=wp.vec4i, device=model.device)
    table.rests = wp.array(rests, dtype=wp.vec4, device=model.device)
    table.balloons = wp.array(quads.balloons, dtype=wp.int32, device=model.device)
    if model.softens:
        table.numbers = wp.array(np.maximum(quads.numbers, 0), dtype=wp.vec4i, device=model.device)
    unit = PLACE_BYTES if resident else 1
    table.places = wp.array(unit * of_slots.reshape(-1, 4), dtype=wp.vec4i, device=model.device)
    return table


def film_entries(model: Model, held: int = 0) -> int:
    """What faces write, with the zero that fills up.

    Args:
        held: faces that there is room for, if that is another number.
    """
    return 4 * (held or len(membrane_quads(model).corners)) + 1


def shapes_of(quads: MembraneQuads) -> np.ndarray:
    """Of the triangles at rest, see `rest_of_shape`, of what is quads alone, shape (n, 4, 4)."""
    g11, g12, g22, _ = np.moveaxis(quads.rests, -1, 0)
    size = np.sqrt(g11 * g22 - g12 * g12)
    return np.stack([(g11 + g12) / size, (g22 + g12) / size, -g12 / size, size], axis=-1)


def _particles_and_places(quads: MembraneQuads, held: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Of each face at each particle, sorted by particle."""
    count = len(quads.corners)
    there = np.ones((4, count), dtype=bool)
    there[2] = quads.triangles == 4
    corner, face = np.nonzero(there)
    particles = quads.corners[face, corner]
    order = np.argsort(particles, kind="stable")
    return particles[order], ((held or count) * corner + face)[order]
