"""Membranes as blocks go through them: face by face."""

from typing import Any

import numpy as np
import warp as wp

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.loops.membrane_face_places import PLACE_BYTES, VECTOR_BYTES, MembraneFaceLayout
from balloon_warp.kernels.membrane_face_tables import MembraneFaceTable
from balloon_warp.model import Model
from balloon_warp.schedules.membranes import MembraneQuads, membrane_quads

MOST_FACES = 12
"""Largest number of faces at a particle: with more at some, most particles would wait for the few"""


def membrane_face_layout(model: Model, features: Features) -> MembraneFaceLayout | None:
    """Return the layout of membrane faces; None without one.

    There is none without membranes, with too many faces at a particle, or with springs that need a loop around a
    particle anyway.
    """
    if not features.membranes or features.rings:
        return None
    quads = membrane_quads(model)
    most = int(np.bincount(_particles_and_places(quads, 0)[0]).max())
    if most > MOST_FACES:
        return None
    triangles = int(quads.triangles.max())
    mixed = bool(quads.triangles.min() < triangles)
    corners = np.diff(model.face_offsets.numpy())
    all_there = len(quads.corners) == model.face_count and (corners == (4 if triangles == 4 else 3)).all()
    return MembraneFaceLayout(most, triangles, mixed, bool(features.measures_areas and all_there and not mixed))


def membrane_face_entries(model: Model, membrane_face: MembraneFaceLayout) -> int:
    """Return the number of entries that faces write, with the zero that pads."""
    return 4 * (membrane_face.room or len(membrane_quads(model).corners)) + 1


def membrane_face_table(model: Model, membrane_face: MembraneFaceLayout | None) -> Any:
    """Return the table of membrane faces for a layout; empty without one."""
    table = MembraneFaceTable()
    if membrane_face is None:
        return table
    quads, in_tile = membrane_quads(model), membrane_face.tile > 0
    particles, places = _particles_and_places(quads, membrane_face.room)
    counts = np.bincount(particles, minlength=model.particle_count)
    slot = np.arange(len(particles)) - np.repeat(np.cumsum(counts) - counts, counts)
    fours, nothing = -(-membrane_face.slots // 4), membrane_face_entries(model, membrane_face) - 1
    in_slots = np.full((4 * fours, model.particle_count), nothing)
    in_slots[slot, particles] = places
    of_slots = in_slots.reshape(fours, 4, -1).swapaxes(1, 2)
    rests = quads.rests.transpose(1, 0, 2).reshape(-1, 4)
    table.corners = wp.array((VECTOR_BYTES if in_tile else 1) * quads.corners, dtype=wp.vec4i, device=model.device)
    table.rests = wp.array(rests, dtype=wp.vec4, device=model.device)
    if membrane_face.quads:
        table.sums = wp.array(sums_of(quads).reshape(-1, 4), dtype=wp.vec4, device=model.device)
    table.balloons = wp.array(quads.balloons, dtype=wp.int32, device=model.device)
    if model.softens:
        table.numbers = wp.array(np.maximum(quads.numbers, 0), dtype=wp.vec4i, device=model.device)
    unit = PLACE_BYTES if in_tile else 1
    table.places = wp.array(unit * of_slots.reshape(-1, 4), dtype=wp.vec4i, device=model.device)
    return table


def sums_of(quads: MembraneQuads) -> np.ndarray:
    """Return the rest sums of quads, see `Sums`, with a k of 1, shape (3, n, 4).

    A triangle's shape at rest are the cotangents of the angles opposite its edges, and the root of its det G.
    """
    g11, g12, g22, _ = np.moveaxis(quads.rests, -1, 0)  # each of the triangles at all corners
    last = np.sqrt(g11 * g22 - g12 * g12)
    by_first, by_second, by_third = (g11 + g12) / last, (g22 + g12) / last, -g12 / last
    along = by_first + np.roll(by_second, -1, axis=1)
    across = by_third + np.roll(by_third, 2, axis=1)
    # the square of a diagonal is at most twice those of both edges beside it
    more = 2.0 * np.maximum(by_third, 0.0)
    first, second = np.maximum(by_first, 0.0) + more, np.maximum(by_second, 0.0) + more
    of_ab = np.stack([first[:, 0], second[:, 1], first[:, 2], second[:, 3]]).max(axis=0)
    of_bc = np.stack([second[:, 0], first[:, 1], second[:, 2], first[:, 3]]).max(axis=0)
    last_row = np.stack([across[:, 1], across[:, 0], of_ab, of_bc], axis=1)
    return np.stack([along, last**-1.5, last_row])


def _particles_and_places(quads: MembraneQuads, room: int) -> tuple[np.ndarray, np.ndarray]:
    """Return particle and place of each face at each particle, sorted by particle.

    Args:
        room: Number of faces that there are places for, if more than there are.
    """
    count = len(quads.corners)
    there = np.ones((4, count), dtype=bool)
    there[2] = quads.triangles == 4
    corner, face = np.nonzero(there)
    particles = quads.corners[face, corner]
    order = np.argsort(particles, kind="stable")
    return particles[order], ((room or count) * corner + face)[order]
