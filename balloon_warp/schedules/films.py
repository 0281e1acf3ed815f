"""Membranes as blocks go through them: face by face."""

from typing import Any

import numpy as np
import warp as wp

from balloon_warp.kernels.film_tables import FilmTable
from balloon_warp.kernels.schedules.block.film_places import PLACE_BYTES, VECTOR_BYTES
from balloon_warp.kernels.schedules.block.memory import FilmLayout
from balloon_warp.kernels.traits import Traits
from balloon_warp.model import Model
from balloon_warp.schedules.film_banks import spread_places, turned_quads
from balloon_warp.schedules.membranes import MembraneQuads, membrane_quads
from balloon_warp.schedules.pair_banks import corners_of_pairs, pairs_dealt_out, quads_in_pairs, quads_of_pairs
from balloon_warp.schedules.pair_ends import B, C, dealt_ends, pairs_around, seats
from balloon_warp.schedules.pairs import paired, shared_edges

MOST_FACES = 12
"""at a particle: where there are more, most particles would wait for the few"""
SLOTS_OF_FOUR = 4
"""which a particle keeps"""


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


def held_layout(model: Model, layout: FilmLayout, held: int, threads: int, renumbered: bool = False) -> FilmLayout:
    """The same where threads hold so many faces: where that is two each, in pairs that stand side by side, if all do.

    Args:
        held: that there is room for.
        renumbered: whether particles may stand in another order.
    """
    layout = layout._replace(held=held)
    if held != 2 * threads:
        return layout
    quads = membrane_quads(model)
    pairs = paired(quads.corners, quads.balloons)
    if not len(pairs):
        return layout
    corners = corners_of_pairs(quads_of_pairs(quads, pairs))
    counts = np.bincount(corners.ravel())
    layout = layout._replace(pairs=len(pairs), slots=int(counts.max()))
    sizes = np.array([model.particle_count, threads])
    if renumbered and layout.slots <= SLOTS_OF_FOUR and len(dealt_ends(corners, sizes)):
        layout = layout._replace(own_slots=max(int(counts[corners[:, [B, C]]].max()) - 1, 1))
    return layout


def film_order(model: Model, layout: FilmLayout | None) -> np.ndarray:
    """The particle at each place."""
    if layout is None or not layout.own_slots:
        return np.arange(model.particle_count)
    quads, sizes = _quads_at_ends(model, layout)
    return seats(corners_of_pairs(quads)[: layout.pairs], sizes)


def _quads_at_ends(model: Model, layout: FilmLayout) -> tuple[MembraneQuads, np.ndarray]:
    """In the order of the threads that have the particles at the ends of their pairs; how many particles and threads
    there are. Threads without a pair measure another again, for nobody: one with their particle, which is taut as soon
    as the others."""
    quads, sizes = membrane_quads(model), np.array([model.particle_count, layout.held // 2])
    pairs = paired(quads.corners, quads.balloons)
    dealt = dealt_ends(corners_of_pairs(quads_of_pairs(quads, pairs)), sizes)
    in_order = pairs_dealt_out(pairs, dealt)
    places = seats(corners_of_pairs(quads_of_pairs(quads, in_order)), sizes)
    edges = shared_edges(quads.corners, quads.balloons)
    others = pairs_around(quads.corners, edges, places[len(pairs) : sizes[1]])
    others = np.where(others < 0, in_order[-1], others)
    return quads_of_pairs(quads, np.concatenate([in_order, others])), sizes


def film_table(model: Model, layout: FilmLayout | None, resident: bool) -> Any:
    """For the layout; empty without one. Particles are in the order of `film_order`.

    Args:
        resident: whether particles stay in registers.
    """
    table = FilmTable()
    if layout is None:
        return table
    quads, particles, places = _quads_and_places(model, layout, resident)
    counts = np.bincount(particles, minlength=model.particle_count)
    slot = np.arange(len(particles)) - np.repeat(np.cumsum(counts) - counts, counts)
    fours, nothing = -(-layout.slots // 4), film_entries(model, layout) - 1
    in_slots = np.full((4 * fours, model.particle_count), -1)
    in_slots[slot, particles] = places
    if resident:
        spread = layout.own_slots or layout.slots
        in_slots[:spread] = spread_places(in_slots[:spread])
    of_slots = np.where(in_slots < 0, nothing, in_slots).reshape(fours, 4, -1).swapaxes(1, 2)
    rests = (shapes_of(quads) if layout.held else quads.rests).transpose(1, 0, 2).reshape(-1, 4)
    table.corners = wp.array((VECTOR_BYTES if resident else 1) * quads.corners, dtype=wp.vec4i, device=model.device)
    table.rests = wp.array(rests, dtype=wp.vec4, device=model.device)
    if layout.held:
        table.sums = wp.array(sums_of(quads).reshape(-1, 4), dtype=wp.vec4, device=model.device)
    table.balloons = wp.array(quads.balloons, dtype=wp.int32, device=model.device)
    if model.softens:
        table.numbers = wp.array(np.maximum(quads.numbers, 0), dtype=wp.vec4i, device=model.device)
    unit = PLACE_BYTES if resident else 1
    table.places = wp.array(unit * of_slots.reshape(-1, 4), dtype=wp.vec4i, device=model.device)
    return table


def film_entries(model: Model, layout: FilmLayout) -> int:
    """What faces write, with the zero that fills up."""
    if layout.pairs:
        return (5 if layout.own_slots else 6) * layout.held // 2 + 1
    return 4 * (layout.held or len(membrane_quads(model).corners)) + 1


def shapes_of(quads: MembraneQuads) -> np.ndarray:
    """Of the triangles at rest, see `rest_of_shape`, of what is quads alone, shape (n, 4, 4)."""
    g11, g12, g22, _ = np.moveaxis(quads.rests, -1, 0)
    size = np.sqrt(g11 * g22 - g12 * g12)
    return np.stack([(g11 + g12) / size, (g22 + g12) / size, -g12 / size, size], axis=-1)


def sums_of(quads: MembraneQuads) -> np.ndarray:
    """Of quads alone, see `Sums`, with a k of 1, shape (3, n, 4)."""
    by_first, by_second, by_third, last = np.moveaxis(shapes_of(quads), -1, 0)  # each of the triangles at all corners
    along = by_first + np.roll(by_second, -1, axis=1)
    across = by_third + np.roll(by_third, 2, axis=1)
    # the square of a diagonal is at most twice those of both edges beside it
    more = 2.0 * np.maximum(by_third, 0.0)
    first, second = np.maximum(by_first, 0.0) + more, np.maximum(by_second, 0.0) + more
    of_ab = np.stack([first[:, 0], second[:, 1], first[:, 2], second[:, 3]]).max(axis=0)
    of_bc = np.stack([second[:, 0], first[:, 1], second[:, 2], first[:, 3]]).max(axis=0)
    last_row = np.stack([across[:, 1], across[:, 0], of_ab, of_bc], axis=1)
    return np.stack([along, last**-1.5, last_row])


def _particles_and_places(quads: MembraneQuads, held: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Of each face at each particle, sorted by particle."""
    count = len(quads.corners)
    there = np.ones((4, count), dtype=bool)
    there[2] = quads.triangles == 4
    corner, face = np.nonzero(there)
    particles = quads.corners[face, corner]
    order = np.argsort(particles, kind="stable")
    return particles[order], ((held or count) * corner + face)[order]


def _quads_and_places(model: Model, layout: FilmLayout, resident: bool) -> tuple[MembraneQuads, np.ndarray, np.ndarray]:
    """The quads in the order of threads, and what a particle reads of them, sorted by particle."""
    quads, threads = membrane_quads(model), layout.held // 2
    if layout.own_slots:
        quads, (count, threads) = _quads_at_ends(model, layout)
        quads = quads._replace(corners=np.argsort(film_order(model, layout))[quads.corners])
        corners = corners_of_pairs(quads)[: layout.pairs, [0, 3, 4, 5, C]]
        corners[: count - threads, -1] = -1
        particles, places = _pairs_and_places(corners, threads)
        return quads, particles[particles >= 0], places[particles >= 0]
    if layout.pairs:
        quads = quads_in_pairs(quads, paired(quads.corners, quads.balloons))
        return quads, *_pairs_and_places(corners_of_pairs(quads), threads)
    if resident and layout.triangles == 4 and not layout.mixed:
        quads = turned_quads(quads, model.particle_count)
    return quads, *_particles_and_places(quads, layout.held)


def _pairs_and_places(corners: np.ndarray, room: int) -> tuple[np.ndarray, np.ndarray]:
    """The same of pairs, which there is room for so many of, by the particles at their corners."""
    particles = corners.T.ravel()
    corner, pair = np.divmod(np.arange(len(particles)), len(corners))
    order = np.argsort(particles, kind="stable")
    return particles[order], (room * corner + pair)[order]
