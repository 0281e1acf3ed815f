"""Memory and tables of worlds that are simulated eight lanes at a time."""

import os
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.kernels.contact.spheres import mark_count
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.lanes import LANE_COUNT, Lanes, Lanes3
from balloon_warp.kernels.schedules.lanes import arguments_of, kinds_of
from balloon_warp.kernels.schedules.lanes_layouts import Layout
from balloon_warp.kernels.schedules.lanes_state import lane_structs, part_structs
from balloon_warp.kernels.schedules.writer import Step
from balloon_warp.model import Model
from balloon_warp.model.state import Room
from balloon_warp.schedules.membranes import MembraneQuads, membrane_quads
from balloon_warp.schedules.slices import spring_ends
from balloon_warp.schedules.tables import other_corners

LANES = int(LANE_COUNT)


@dataclass(frozen=True)
class Items:
    """Items that the lanes hold at once: particles of eight worlds, or octets of particles, each of one balloon."""

    layout: Layout
    offsets: NDArray[np.int64]
    """Begin of each balloon's items, and the end of the last"""
    particles: NDArray[np.int64]
    """Particle at each place, -1 where an octet is padded"""

    @property
    def count(self) -> int:
        """Number of items."""
        return int(self.offsets[-1])

    @property
    def places(self) -> NDArray[np.int64]:
        """Place of each particle."""
        of_particle = np.zeros(self.particles.max() + 1, dtype=np.int64)
        filled = self.particles >= 0
        of_particle[self.particles[filled]] = np.flatnonzero(filled)
        return of_particle


def items_of(model: Model, layout: Layout) -> Items:
    """Return the items of a model."""
    offsets = np.array(model.particle_offsets)
    if layout.worlds:
        return Items(layout, offsets, np.arange(offsets[-1]))
    octets = np.cumsum([0, *(-(-np.diff(offsets) // LANES))])
    particles = np.full(LANES * octets[-1], -1)
    for balloon, (begin, end) in enumerate(pairwise(offsets.tolist())):
        particles[LANES * octets[balloon] :][: end - begin] = np.arange(begin, end)
    return Items(layout, octets, particles)


@dataclass(frozen=True)
class Entries:
    """Entries of particles, item by item: an octet lists as many as the particle with most."""

    offsets: NDArray[np.int64]
    """Begin of each item's entries, and the end of the last"""
    sources: NDArray[np.int64]
    """Entry of each lane, -1 if it has none; shape (n,) or (n, 8)"""
    owners: NDArray[np.int64]
    """Place that each entry belongs to, of the same shape"""


def list_entries(items: Items, particles: NDArray[np.int64], classes: NDArray[np.int64]) -> Entries:
    """Return the n-th of a class of each particle's entries, side by side.

    Args:
        particles: of each entry, ascending.
        classes: of each entry: the lanes have entries of one class at a time.
    """
    if items.layout.worlds:
        order = np.lexsort([classes, particles])
        offsets = np.searchsorted(particles[order], np.arange(items.count + 1))
        return Entries(offsets, order, particles[order])
    if not len(particles):
        none = np.zeros((0, LANES), dtype=np.int64)
        return Entries(np.zeros(items.count + 1, dtype=np.int64), none, none)
    places = items.places[particles]
    kinds, kind = np.unique(classes, return_inverse=True)
    order = np.lexsort([kind, places])
    cell = places[order] * len(kinds) + kind[order]  # a particle's entries of one class
    nth = np.arange(len(cell)) - np.searchsorted(cell, cell)
    counts = np.bincount(cell, minlength=LANES * items.count * len(kinds))
    widths = counts.reshape(items.count, LANES, len(kinds)).max(axis=1)
    begins = np.cumsum(np.append(0, widths.ravel()))
    octet, lane = np.divmod(places[order], LANES)
    row = begins[octet * len(kinds) + kind[order]] + nth
    sources = np.full((int(begins[-1]), LANES), -1)
    sources[row, lane] = order
    owners = np.repeat(np.arange(items.count), widths.sum(axis=1))[:, None] * LANES + np.arange(LANES)
    return Entries(begins[:: len(kinds)], sources, owners)


def make_lane_tables(model: Model, features: Features, layout: Layout, tables: Any) -> Any:
    """Return the model item by item."""
    items = items_of(model, layout)
    t = lane_structs(layout).tables()

    def array(values: Any, dtype: Any) -> Any:
        return wp.array(np.asarray(values), dtype=dtype, device=model.device)

    t.all = tables
    t.up, t.step_seconds, t.substeps = model.up, model.step_seconds, model.substeps
    t.lane_count, t.world_count = LANES, model.world_count
    t.item_offsets, t.particles = array(items.offsets, wp.int32), array(items.particles, wp.int32)
    shares = np.append(model.particle_mass_share.numpy(), 0.0)[items.particles]
    t.shares = array(shares if layout.worlds else shares.reshape(-1, LANES), layout.number)
    held = np.append(np.diff(tables.strings.offsets.numpy()) if model.string_count else [], 0)
    lanes = 1 if layout.worlds else LANES
    t.held = array(held[items.particles].reshape(-1, lanes).any(axis=1) if model.string_count else [], wp.int32)
    t.places = array(items.places, wp.int32)
    if not layout.worlds:
        t.present = array((items.particles >= 0).reshape(-1, LANES), layout.number)
    if features.jets:
        weights = np.append(model.neck_weights.numpy(), 0.0)[items.particles]
        t.necks.weights = array(weights if layout.worlds else weights.reshape(-1, LANES), layout.number)
    if features.driven:
        first = np.append(tables.outer.slots.numpy()[:, 0], 0.0)[items.particles]
        t.outer.slots = array(first[:, None] if layout.worlds else first.reshape(-1, 1, LANES), layout.number)
    _add_springs(t, model, features, items, array)
    if features.membranes:
        _add_membranes(t, model, features, items, array)
    if features.measures_areas:
        _add_fans(t, model, items, array)
    if features.inflation_directions:
        _add_faces(t, model, items, array)
    return t


def _add_springs(t: Any, model: Model, features: Features, items: Items, array: Any) -> None:
    ends = spring_ends(model)
    entries = list_entries(items, ends.particle, ends.kind)
    there = entries.sources >= 0
    kinds = ends.kind[entries.sources]
    if not items.layout.worlds:
        kinds = np.where(there, kinds, -1).max(axis=1)  # the same in all lanes that have a spring

    def placed(values: NDArray) -> Any:
        return array(np.where(there, values[entries.sources], 0.0), items.layout.number)

    t.spring_offsets = array(entries.offsets, wp.int32)
    t.spring_kinds = array(kinds, wp.int32)
    neighbors = items.places[ends.neighbor]
    t.spring_ends = array(np.where(there, neighbors[entries.sources], entries.owners), items.layout.reference)
    t.spring_lengths = placed(ends.rest_length)
    t.spring_scales = placed(ends.scale) if features.springs_vary else array([], items.layout.number)


def _quads_of(model: Model, layout: Layout) -> MembraneQuads:
    """Return quads and triangles, or eight alike of one balloon, with a last axis of lanes; padding has no area.

    Eight worlds go through quads in the same order, with the same padding, which there has no triangle: the sums of
    quads are alike in both.
    """
    quads = membrane_quads(model)
    alike, counts = np.unique(np.stack([quads.balloons, -quads.triangles]), axis=1, return_counts=True)
    octets, ends = -(-counts // LANES), np.cumsum(counts)
    begins = LANES * (np.cumsum(octets) - octets)
    places = np.repeat(begins - ends + counts, counts).astype(np.int64) + np.arange(len(quads.corners))

    def filled(values: NDArray, nothing: int) -> NDArray:
        rows = np.full((LANES * int(octets.sum()), *values.shape[1:]), nothing, dtype=values.dtype)
        rows[places] = values
        return rows if layout.worlds else np.moveaxis(rows.reshape(-1, LANES, *values.shape[1:]), 1, -1)

    rows = LANES * octets if layout.worlds else octets
    return MembraneQuads(
        filled(quads.corners, -1),
        filled(quads.rests, 0),
        filled(quads.triangles, 0) if layout.worlds else np.repeat(-alike[1], octets),
        filled(quads.numbers, -1),
        np.repeat(alike[0], rows),
    )


def _add_membranes(t: Any, model: Model, features: Features, items: Items, array: Any) -> None:
    quads, layout = _quads_of(model, items.layout), items.layout
    corners = np.where(quads.corners >= 0, items.places[quads.corners], 0)
    t.quad_offsets = array(np.searchsorted(quads.balloons, np.arange(model.balloon_count + 1)), wp.int32)
    t.quads = array(corners.reshape(-1, *corners.shape[2:]), layout.reference)
    t.quad_rests = array(quads.rests.reshape(-1, *quads.rests.shape[2:]), layout.four)
    t.quad_triangles = array(quads.triangles, wp.int32)
    numbers = quads.numbers if features.wears else quads.numbers[:0]
    t.quad_numbers = array(numbers.reshape(-1, *numbers.shape[2:]), layout.reference)


def _add_fans(t: Any, model: Model, items: Items, array: Any) -> None:
    """Add the fans of faces; padding is a face of a particle alone."""
    fans = other_corners(model)
    entries = list_entries(items, fans.particles, fans.sizes)
    lanes = 1 if items.layout.worlds else LANES
    sources, owners = entries.sources.reshape(-1, lanes), entries.owners.reshape(-1, lanes)
    sizes = fans.sizes[sources.max(axis=1)]  # the same in all lanes that have a fan
    begins = np.append(0, np.cumsum(sizes))
    fan = np.repeat(np.arange(len(sizes)), sizes)
    nth = np.arange(begins[-1]) - begins[fan]
    there = sources[fan] >= 0
    corners = fans.others[np.where(there, fans.begins[sources[fan]] + nth[:, None], 0)]
    flat = np.where(there, items.places[corners], owners[fan])
    table = part_structs(items.layout)[1]()
    table.offsets, table.begins = array(entries.offsets, wp.int32), array(begins, wp.int32)
    table.particles = array(flat.ravel() if items.layout.worlds else flat, items.layout.reference)
    t.fans = table


def _add_faces(t: Any, model: Model, items: Items, array: Any) -> None:
    """Add faces, or eight faces of one balloon with as many corners; padding has no area, and is far away."""
    begins = np.asarray(model.face_offsets.numpy(), dtype=np.int64)
    corners = items.places[np.asarray(model.face_particles.numpy(), dtype=np.int64)]
    around_offsets = np.asarray(model.particle_face_offsets.numpy(), dtype=np.int64)
    particles = np.repeat(np.arange(model.particle_count), np.diff(around_offsets))
    around = list_entries(items, particles, np.zeros_like(particles))
    faces = np.asarray(model.particle_faces.numpy(), dtype=np.int64)
    balloons = np.asarray(model.face_balloon.numpy(), dtype=np.int64)
    table = part_structs(items.layout)[0]()
    table.particle_offsets = array(around.offsets, wp.int32)
    if items.layout.worlds:
        table.offsets, table.particles = array(begins, wp.int32), array(corners, wp.int32)
        table.balloon_offsets = array(np.searchsorted(balloons, np.arange(model.balloon_count + 1)), wp.int32)
        table.around_particles = array(faces[around.sources], wp.int32)
        t.faces = table
        return
    octets = face_octets(model)
    listed, offsets = [], [0]
    where = np.zeros(model.face_count, dtype=np.int64)
    for number, members in enumerate(octets):
        size = int(begins[members[0] + 1] - begins[members[0]])
        block = np.zeros((size, LANES), dtype=np.int64)  # one corner for all, where an octet is filled up
        block[:, : len(members)] = corners[begins[members][None] + np.arange(size)[:, None]]
        listed.append(block)
        offsets.append(offsets[-1] + size)
        where[members] = LANES * number + np.arange(len(members))
    table.offsets, table.particles = array(offsets, wp.int32), array(np.concatenate(listed), items.layout.reference)
    of_octets = [balloons[members[0]] for members in octets]
    table.balloon_offsets = array(np.searchsorted(of_octets, np.arange(model.balloon_count + 1)), wp.int32)
    nothing = LANES * len(octets)
    seen = np.where(around.sources >= 0, where[faces[around.sources]], nothing)
    table.around_particles = array(seen, items.layout.reference)
    t.faces = table


def face_octets(model: Model) -> list[NDArray[np.int64]]:
    """Return the faces of one balloon with as many corners, up to eight at a time."""
    alike = np.stack([model.face_balloon.numpy(), np.diff(model.face_offsets.numpy())]).astype(np.int64)
    octets = []
    for kind in np.unique(alike, axis=1).T:
        members = np.flatnonzero((alike == kind[:, None]).all(axis=0))
        octets += [members[first : first + LANES] for first in range(0, len(members), LANES)]
    return octets


FAR_AWAY = 1e16
"""Coordinate of a face that is nearest to no particle [m], whose square is a finite float"""


class LaneMemory(NamedTuple):
    """Arrays by name; those that a scene does not need are empty."""

    of_kernel: dict[str, Any]
    """State and values, as arguments of the kernel"""
    of_tables: dict[str, Any]
    solids: dict[str, Any]
    working: dict[str, Any]


def group_count(model: Model, layout: Layout) -> int:
    """Return the groups of worlds, or worlds."""
    return -(-model.world_count // LANES) if layout.worlds else model.world_count


def shares_of(model: Model, layout: Layout, thread_count: int | None = None) -> list[NDArray[np.int64]]:
    """Return the groups of each thread; a thread a core, if not given, and no more than there are groups."""
    groups = group_count(model, layout)
    return np.array_split(np.arange(groups), min(thread_count or os.cpu_count() or 1, groups))


def allocate_lanes(model: Model, step: Step, layout: Layout, room: Room) -> LaneMemory:
    """Ask for it."""
    groups, items, features = group_count(model, layout), items_of(model, layout).count, step.features
    balloons, width = model.balloon_count, features.columns.width
    solids = model.sphere_count + (len(model.obstacles) if features.may_touch_obstacles else 0)
    adds_up = bool(features.membranes) or features.has("hinge") or features.has("face")
    return LaneMemory(
        _of_kernel(model, step, layout, room),
        {
            "numbers": room.array((groups, balloons, width), Lanes),
            "forces": room.array((groups, _places(layout, items) if adds_up else 0), layout.vector),
        },
        {
            "centers": room.array((groups, solids), Lanes3),
            "motions": room.array((groups, solids), Lanes3),
            "reaches": room.array((groups, solids), Lanes),
        },
        _working(model, features, groups * (LANES if layout.worlds else 1), room),
    )


def _places(layout: Layout, items: int) -> int:
    """Return the number of entries: of eight worlds, or of each particle of an octet."""
    return items if layout.worlds else LANES * items


def _of_kernel(model: Model, step: Step, layout: Layout, room: Room) -> dict[str, Any]:
    groups, items, takes = group_count(model, layout), items_of(model, layout).count, arguments_of(step, layout)
    faces = model.face_count if layout.worlds else len(face_octets(model))
    counts = {"particle": items, "face": faces, "balloon": model.balloon_count}
    arrays = {}
    for place in ("all_points", "other_points", "all_velocities", "other_velocities"):
        if place in takes:
            shown = "Seen" in takes[place]
            shape = (groups, _places(layout, items) if shown else items)
            arrays[place] = room.array(shape, layout.vector if shown else Lanes3)
    for name, (item, kind) in kinds_of(step, layout).items():
        shown = kind is layout.vector and not layout.worlds
        arrays[f"all_{name}"] = room.array((groups, LANES * counts[item] + 1 if shown else counts[item]), kind)
        if f"all_{name}_parts" in takes:
            arrays[f"all_{name}_parts"] = room.array((groups, LANES), kind)
    return arrays


def put_far_away(arrays: dict[str, Any], layout: Layout) -> None:
    """Place the padding face of octets far away, so that it is nearest to no particle."""
    if not layout.worlds and "all_face_center" in arrays:
        centers = arrays["all_face_center"].numpy()
        centers[:, -1] = FAR_AWAY
        arrays["all_face_center"].assign(centers)


def _working(model: Model, features: Features, worlds: int, room: Room) -> dict[str, Any]:
    spheres = model.sphere_count
    return {
        "gas_masses": room.array((worlds, model.balloon_count if features.gas else 0), wp.float32),
        "sphere_quanta": room.array((worlds, spheres if features.spheres_pushed else 0, 3), wp.int64),
        "sphere_starts": room.array((worlds, spheres if features.keeps_starts else 0), wp.vec3),
        "near": room.array((worlds, mark_count(model.particle_count) if features.impulses else 0), wp.int32),
    }


def rows_of(numbers: Any) -> Any:
    """Return numbers by group, lane and balloon: a row each."""
    groups, balloons, width = numbers.shape
    flat = wp.array(
        ptr=numbers.ptr, shape=(groups, balloons, width, LANES), dtype=wp.float32, device=numbers.device, copy=False
    )
    return flat.transpose((0, 3, 1, 2))
