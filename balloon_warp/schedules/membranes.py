"""The tables of membranes."""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.kernels.laws import Law
from balloon_warp.kernels.laws.membrane import MEMBRANES
from balloon_warp.kernels.laws.softening import PARAMETERS as SOFTENING
from balloon_warp.kernels.tables import MembraneTable
from balloon_warp.kernels.wear_tables import WearTable
from balloon_warp.model import Model
from balloon_warp.model.memory import Allocating, Room
from balloon_warp.schedules.slices import slices_of
from balloon_warp.schedules.tears import tear_table, tears_of_world
from balloon_warp.springs.membrane import Membrane


def membrane_laws(model: Model) -> tuple[Law, ...]:
    """Return the membrane laws of the model's balloons, each once."""
    kinds = {balloon.material.law for balloon in model.scene.balloon}
    return tuple(law for name, law in MEMBRANES.items() if name in kinds)


def membrane_table(model: Model) -> Any:
    """Return the triangles, each once and from each of its corners."""
    table = MembraneTable()
    table.corners, table.corner_rests = model.membrane_corners, model.membrane_rests
    if not model.triangle_count:
        return table
    names = [law.name for law in membrane_laws(model)]
    of_balloons = [balloon.material.law for balloon in model.scene.balloon]
    table.materials = _array(model, [names.index(law) if law in names else 0 for law in of_balloons], wp.int32)
    around = corner_triangles(model)
    counts = np.bincount(around.particles, minlength=model.particle_count)
    slices = slices_of(around.particles, counts, 1)
    others = np.repeat(slices.owners[:, None], 2, axis=1)
    others[slices.places] = around.others
    rests = np.zeros((len(others), 4))
    rests[slices.places] = around.rests
    table.slice_offsets = _array(model, slices.offsets, wp.int32)
    table.counts = _array(model, counts, wp.int32)
    table.others, table.rests = _array(model, others, wp.vec2i), _array(model, rests, wp.vec4)
    if model.softens or model.bursts:
        numbers = np.zeros(len(others))
        numbers[slices.places] = around.numbers
        table.wear.numbers = _array(model, numbers, wp.int32)
        table.wear.left = left_array(model, Allocating(model.device))
        put_wear_parameters(table.wear, model)
    if model.bursts:
        table.wear.tears = tear_table(model)
    return table


def left_array(model: Model, room: Room) -> Any:
    """Return the memory for the remaining fraction of triangles' tensions, where rubber softens or tears."""
    wears = model.softens or model.bursts
    return room.array((model.world_count, model.triangle_count if wears else 0), wp.float32)


def membranes_of_world(model: Model, membranes: Any) -> Any:
    """Return a batch's table for one of its worlds."""
    if not model.softens and not model.bursts:
        return membranes
    table, wear = MembraneTable(), WearTable()
    for name in MembraneTable.vars:
        setattr(table, name, getattr(membranes, name))
    wear.numbers, wear.left = membranes.wear.numbers, membranes.wear.left[:1]
    put_wear_parameters(wear, model)
    if model.bursts:
        wear.tears = tears_of_world(model, membranes.wear.tears)
    table.wear = wear
    return table


def put_wear_parameters(wear: Any, model: Model) -> None:
    """Store the wear parameters of the balloons in the model's worlds."""
    for row in SOFTENING:
        setattr(wear, row.name, model.parameters[row.name])


class CornerTriangles(NamedTuple):
    """The triangles from each of their corners, sorted by particle."""

    particles: NDArray[np.int64]
    """Particle of the corner itself, shape (n,)"""
    others: NDArray[np.int64]
    """Other two corners, shape (n, 2)"""
    rests: NDArray[np.float64]
    """Rest metrics with the particle as the first corner, see `MembraneTable`, shape (n, 4)"""
    numbers: NDArray[np.int64]
    """Numbers of the triangles, shape (n,)"""


def corner_triangles(model: Model) -> CornerTriangles:
    """Return the triangles at the corners of all balloons."""
    shapes = [shape.membrane for shape in model.shapes]
    triangles = Membrane(
        np.asarray(model.membrane_corners.numpy(), dtype=np.int64),
        np.concatenate([membrane.areas for membrane in shapes]),
        np.concatenate([membrane.edges for membrane in shapes]),
    )
    turned = [triangles.turned(turns) for turns in range(3)]
    corners = np.concatenate([each.corners for each in turned])
    rests = np.concatenate([each.rests for each in turned])
    order = np.argsort(corners[:, 0], kind="stable")
    return CornerTriangles(corners[order, 0], corners[order, 1:], rests[order], order % triangles.count)


class MembraneQuads(NamedTuple):
    """The triangles of membranes by fours, those of a quad, and by ones: of each balloon first those, then these."""

    corners: NDArray[np.int64]
    """Corners; of a triangle the first, the second, the first again, and the third; shape (n, 4)"""
    rests: NDArray[np.float64]
    """Rest metric of the triangle at each corner, from there to the next and the last, see `MembraneTable`; a triangle
    has one at its first, shape (n, 4, 4)"""
    triangles: NDArray[np.int64]
    """4 or 1, shape (n,)"""
    numbers: NDArray[np.int64]
    """Number of the triangle at each corner, -1 where there is none, shape (n, 4)"""
    balloons: NDArray[np.int64]
    """Balloon of each quad, shape (n,)"""


def membrane_quads(model: Model) -> MembraneQuads:
    """Return the membrane quads of all balloons."""
    corners, rests, triangles, places, balloons, begin = [], [], [], [], [], 0
    numbers = np.asarray(model.membrane_corners.numpy(), dtype=np.int64).reshape(-1, 3)
    for balloon, membrane in enumerate(shape.membrane for shape in model.shapes):
        here = replace(membrane, corners=numbers[begin : begin + membrane.count])
        rows = here.quad_rows
        others = np.setdiff1d(np.arange(here.count), rows.ravel())
        alone = here.part(others)
        # (a, b, d), (a, b, c), (b, c, d) and (a, c, d), each turned until it begins with the corner it lies at
        at_corners = [here.part(rows[:, row]).turned(turns) for row, turns in ((1, 0), (0, 1), (3, 1), (2, 2))]
        corners += [np.stack([each.corners[:, 0] for each in at_corners], axis=1), alone.corners[:, [0, 1, 0, 2]]]
        rests += [np.stack([each.rests for each in at_corners], axis=1), _at_first(alone.rests)]
        places += [begin + rows[:, [1, 0, 3, 2]], np.pad(begin + others[:, None], ((0, 0), (0, 3)), constant_values=-1)]
        triangles += [4] * len(rows) + [1] * alone.count
        balloons += [balloon] * (len(rows) + alone.count)
        begin += membrane.count
    return MembraneQuads(
        np.concatenate(corners),
        np.concatenate(rests),
        np.array(triangles, dtype=np.int64),
        np.concatenate(places),
        np.array(balloons, dtype=np.int64),
    )


def _at_first(rests: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rest metrics of lone triangles, at their first corner, shape (n, 4, 4)."""
    padded = np.zeros((len(rests), 4, 4))
    padded[:, 0] = rests
    return padded


def _array(model: Model, values: Any, dtype: Any) -> wp.array:
    return wp.array(np.asarray(values), dtype=dtype, device=model.device)
