"""Memoize searches of arrays that take long and are asked again, by the next share of a batch of the same meshes.

Particles' springs and quads as threads read them: slices, slots, rings, and an order without bank conflicts.

Assignment of neighbors to slots and of particles to threads that avoids bank conflicts in shared memory.

Shared memory has 32 banks, a word wide. A point is three words, so that particle p starts in bank 3 p mod 32, and two
particles share their banks if they are equal mod 32. In one load, the 32 threads of a warp each read a neighbor: it
takes as many wavefronts a word as there are different neighbors in the fullest bank. Which of its neighbors a particle
reads in which of its slots is free, and a local search spreads them.

A model with its particles in another order, so that the threads of a warp have as many springs each.

Otherwise a warp takes as long as its particle with the most springs.
"""

import hashlib
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import wraps
from typing import Any, Concatenate
from weakref import WeakKeyDictionary

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.kernels.loops.springs import SlotTable
from balloon_warp.kernels.tables import SLICE, ParticleTable, RingTable
from balloon_warp.model import Model

Search = Callable[Concatenate[NDArray[np.int64], ...], NDArray[np.int64]]
LAST = 8
"""Number of results kept of a function"""


def memoized(search: Search) -> Search:
    """Memoize a function of arrays; cached arrays are read-only."""
    answers: OrderedDict[str, NDArray[np.int64]] = OrderedDict()

    @wraps(search)
    def recall(*asked: NDArray[np.int64]) -> NDArray[np.int64]:
        key = hashlib.sha256()
        for array in asked:
            key.update(f"{array.shape} {array.dtype}".encode())
            key.update(np.ascontiguousarray(array).data)
        answer = answers.pop(key.hexdigest(), None)
        if answer is None:
            answer = search(*asked).copy()
            answer.setflags(write=False)
        answers[key.hexdigest()] = answer
        while len(answers) > LAST:
            answers.popitem(last=False)
        return answer

    return recall


def particle_table(model: Model) -> Any:
    """Return each particle's balloon and share of its mass, and where each balloon's particles begin."""
    table = ParticleTable()
    table.balloon, table.mass_share = model.particle_balloon, model.particle_mass_share
    table.offsets = wp.array(model.particle_offsets, dtype=wp.int32, device=model.device)
    return table


@dataclass(frozen=True)
class Slices:
    """Places of particles' entries, in slices of 32 particles."""

    offsets: NDArray[np.int64]
    places: NDArray[np.int64]
    """Place of each entry, sorted by particle"""
    owners: NDArray[np.int64]
    """Particle of each place, padded ones included"""


def slices_of(particles: NDArray[np.int64], counts: NDArray[np.int64], step: int) -> Slices:
    """Return each particle's entries filled up to a multiple of the step, and to the most in its slice."""
    slot = np.arange(len(particles)) - np.repeat(np.cumsum(counts) - counts, counts)
    padded = np.zeros(-(-len(counts) // SLICE) * SLICE, dtype=np.int64)
    padded[: len(counts)] = -(-counts // step) * step
    widths = padded.reshape(-1, SLICE).max(axis=1)
    offsets = SLICE * np.cumsum(np.append(0, widths))
    widths[-1] += 1  # room to read ahead of the last
    in_slice = np.arange(SLICE * widths.sum()) % SLICE
    owners = np.minimum(np.repeat(np.arange(len(widths)), SLICE * widths) * SLICE + in_slice, len(counts) - 1)
    return Slices(offsets, offsets[particles // SLICE] + SLICE * slot + particles % SLICE, owners)


@dataclass(frozen=True)
class SpringEnds:
    """Every spring twice, from each of its ends, sorted by particle, kind and neighbor."""

    particle: NDArray[np.int64]
    neighbor: NDArray[np.int64]
    kind: NDArray[np.int64]
    scale: NDArray[np.float64]
    """Spring constant over that of its kind"""
    rest_length: NDArray[np.float64]
    """Rest length [m]"""
    by_kind: NDArray[np.int64]
    """Number of springs of each kind at each particle, shape (particle_count, 3)"""


def spring_ends(model: Model) -> SpringEnds:
    """Return the model's springs as its particles see them."""
    ends = model.spring_particles.numpy().astype(np.int64).reshape(-1, 2)
    kind = np.tile(model.spring_kind.numpy().astype(np.int64), 2)
    particle, neighbor = np.concatenate([ends, ends[:, ::-1]]).T
    count = model.particle_count
    order = np.argsort(count * (3 * particle + kind) + neighbor, kind="stable")
    return SpringEnds(
        particle=particle[order],
        neighbor=neighbor[order],
        kind=kind[order],
        scale=np.tile(np.asarray(model.spring_stiffness_scale.numpy(), dtype=np.float64), 2)[order],
        rest_length=np.tile(np.asarray(model.spring_rest_length.numpy(), dtype=np.float64), 2)[order],
        by_kind=np.bincount(3 * particle + kind, minlength=3 * count).reshape(count, 3),
    )


def neighbors_in_slots(ends: SpringEnds, kind: int) -> NDArray[np.int64]:
    """Return the particles at the other ends of each particle's springs of a kind, shape (slot_count, particle_count).

    -1 marks an empty slot.
    """
    counts = ends.by_kind[:, kind]
    of_kind = ends.kind == kind
    particle = ends.particle[of_kind]
    neighbors = np.full((counts.max(), len(counts)), -1)
    neighbors[np.arange(len(particle)) - np.repeat(np.cumsum(counts) - counts, counts), particle] = ends.neighbor[
        of_kind
    ]
    return neighbors


Ring = tuple[NDArray[np.int64], NDArray[np.int64]]
"""The particles around each particle, along edges and across quads, in turns: e0 s0 e1 s1 ...; -1 where there are no
more. Each of shape (most, particle_count)"""
STRUCTURAL, SHEAR, FLEXION = range(3)
_FOUND: WeakKeyDictionary[Model, Ring | None] = WeakKeyDictionary()


def quad_rings(model: Model) -> Ring | None:
    """Return the rings of quads around particles, or None, found once for each model.

    Every particle must have one whose neighbors are those of its structural and of its shear springs: on closed
    surfaces of quads.
    """
    if model not in _FOUND:
        _FOUND[model] = _rings_of(model)
    return _FOUND[model]


def min_valence(ring: Ring) -> int:
    """Return the least number of quads around a particle."""
    return int((ring[STRUCTURAL] >= 0).sum(axis=0).min())


def _rings_of(model: Model) -> Ring | None:
    if (np.diff(model.face_offsets.numpy()) != 4).any():
        return None
    count = model.particle_count
    corners = np.asarray(model.face_particles.numpy(), dtype=np.int64).reshape(-1, 4)
    particle, after, opposite, before = np.concatenate([np.roll(corners, -turn, axis=1) for turn in range(4)]).T
    quads = np.bincount(particle, minlength=count)
    by_edge = np.argsort(count * particle + before, kind="stable")
    edges = (count * particle + before)[by_edge]
    wanted = count * particle + after
    place = np.minimum(np.searchsorted(edges, wanted), len(edges) - 1)
    if not quads.all() or (np.diff(edges) == 0).any() or (edges[place] != wanted).any():
        return None
    following = by_edge[place]
    _, first = np.unique(particle, return_index=True)
    along = np.full((quads.max(), count), -1)
    across = np.full_like(along, -1)
    quad = first
    for turn in range(len(along)):
        going = turn < quads
        if turn and (going & (quad == first)).any():
            return None  # two fans meet in a particle
        along[turn, going], across[turn, going] = before[quad[going]], opposite[quad[going]]
        quad = np.where(going, following[quad], quad)
    ends = spring_ends(model)
    same = _same(ends, along, STRUCTURAL) and _same(ends, across, SHEAR)
    return (along, across) if same else None


def _same(ends: SpringEnds, around: NDArray[np.int64], kind: int) -> bool:
    """Return whether neighbors are the particles' neighbors by springs of a kind."""
    count = around.shape[1]
    particle, neighbor = _entries(around)
    of_kind = ends.kind == kind
    return np.array_equal(np.sort(count * particle + neighbor), count * ends.particle[of_kind] + ends.neighbor[of_kind])


def _entries(around: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return each particle and a neighbor of it, sorted by particle and in the order of its ring."""
    turns = around.T
    particle = np.repeat(np.arange(len(turns)), turns.shape[1]).reshape(turns.shape)
    return particle[turns >= 0], turns[turns >= 0]


def ring_table(model: Model, ends: SpringEnds, ring: Ring | None, springs_vary: bool, in_block: bool) -> Any:
    """Return the rings as kernels read them.

    Args:
        in_block: for a block, whose worlds have so few particles that 16 bits number them.
    """
    table = RingTable()
    if ring is None:
        return table
    along, across = ring
    flexion = neighbors_in_slots(ends, FLEXION)
    count = model.particle_count
    around, opposite = _entries(across)
    quads = np.bincount(around, minlength=count)
    turn = np.arange(len(around)) - np.repeat(np.cumsum(quads) - quads, quads)
    next_along = along[(turn + 1) % quads[around], around]
    bent, other = _pairs_of(flexion)
    pairs = np.bincount(bent, minlength=count)

    particle = np.concatenate([around, bent])
    neighbors = np.concatenate([np.stack([opposite, next_along], axis=1), other])
    kinds = np.repeat([[SHEAR, STRUCTURAL], [FLEXION, FLEXION]], [len(around), len(bent)], axis=0)
    in_order = np.argsort(particle, kind="stable")
    particle, neighbors, kinds = particle[in_order], neighbors[in_order], kinds[in_order]
    slices = slices_of(particle, quads + pairs, 1)

    key = count * (3 * ends.particle + ends.kind) + ends.neighbor
    spring = np.searchsorted(key, count * (3 * particle[:, None] + kinds) + neighbors)
    there = neighbors != particle[:, None]
    spring[~there] = 0
    others = np.repeat(slices.owners[:, None], 2, axis=1)
    others[slices.places] = neighbors
    lengths, scales = np.zeros((2, len(slices.owners), 2), dtype=np.float32)
    lengths[slices.places] = np.where(there, ends.rest_length[spring], 0.0)
    scales[slices.places] = np.where(there, ends.scale[spring], 0.0)
    first = slices.offsets[np.arange(count) // SLICE] + np.arange(count) % SLICE

    def array(values: NDArray, dtype: Any) -> wp.array:
        return wp.array(values, dtype=dtype, device=model.device)

    table.places = array(np.stack([first, quads, pairs, along[0]], axis=1), wp.vec4i)
    if in_block:
        table.packed_ends = array((others[:, 0] | others[:, 1] << 16).astype(np.uint32).view(np.int32), wp.int32)
    else:
        table.ends = array(others, wp.vec2i)
    table.lengths = array(lengths, wp.vec2)
    if springs_vary:
        table.scales = array(scales, wp.vec2)
    return table


def _pairs_of(neighbors: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the neighbors in slots two at a time: particles, and two neighbors of each, shape (pair_count, 2).

    -1 marks an empty slot; where there is one neighbor only, the second is the particle itself.
    """
    slots, count = neighbors.shape
    even = np.concatenate([neighbors, np.full((slots % 2, count), -1)])
    two = even.T.reshape(count, -1, 2)
    particle = np.broadcast_to(np.arange(count)[:, None], two.shape[:2])
    there = two[..., 0] >= 0
    return particle[there], np.where(two[there] < 0, particle[there][:, None], two[there])


BANKS = 32
SEARCH_STEPS = 1500


def wavefronts(neighbors: NDArray[np.int64]) -> float:
    """Return the wavefronts a word that a load takes, on average; 1 without conflicts.

    Args:
        neighbors: the particle that each reads in each slot, shape (slot_count, particle_count).
    """
    slots, count = neighbors.shape
    groups = -(-count // BANKS)
    loaded = np.zeros((slots, groups, count), dtype=bool)
    loaded[np.arange(slots)[:, None], np.arange(count) // BANKS, neighbors] = True
    padded = np.zeros((slots, groups, groups * BANKS), dtype=bool)
    padded[..., :count] = loaded
    return float(padded.reshape(slots, groups, groups, BANKS).sum(axis=2).max(axis=2).mean())


@memoized
def spread_over_banks(neighbors: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return an order of each particle's slots, shape (slot_count, particle_count): `take_along_axis` applies it.

    A search: in each warp, two slots of one particle are exchanged, again and again, and the exchange is kept if the
    cubes of the banks' loads do not add up to more.
    """
    slots, count = neighbors.shape
    order = np.repeat(np.arange(slots)[:, None], count, axis=1)
    if slots < 2:
        return order
    groups = -(-count // BANKS)
    group = np.arange(groups)
    current = neighbors.copy()
    readers = np.zeros((groups, slots, count), dtype=np.int32)
    np.add.at(readers, (np.arange(count) // BANKS, np.arange(slots)[:, None], current), 1)
    loads = np.zeros((groups, slots, BANKS), dtype=np.int32)
    np.add.at(loads, (*np.nonzero(readers)[:2], np.nonzero(readers)[2] % BANKS), 1)

    def move(chosen: NDArray, particle: NDArray, source: NDArray, target: NDArray) -> None:
        """Swap the slots in which a thread of each chosen group reads a particle."""
        bank = particle % BANKS
        readers[chosen, source, particle] -= 1
        loads[chosen, source, bank] -= readers[chosen, source, particle] == 0
        loads[chosen, target, bank] += readers[chosen, target, particle] == 0
        readers[chosen, target, particle] += 1

    random = np.random.default_rng(0)
    for _ in range(SEARCH_STEPS):
        particle = np.minimum(group * BANKS + random.integers(BANKS, size=groups), count - 1)
        first = random.integers(slots, size=groups)
        second = (first + 1 + random.integers(slots - 1, size=groups)) % slots
        one, other = current[first, particle], current[second, particle]
        cells = (group, np.stack([first, second, first, second]), np.stack([one, one, other, other]) % BANKS)
        before = (loads[cells] ** 3).sum(axis=0)
        move(group, one, first, second)
        move(group, other, second, first)
        worse = (loads[cells] ** 3).sum(axis=0) > before
        move(group[worse], one[worse], second[worse], first[worse])
        move(group[worse], other[worse], first[worse], second[worse])
        kept = ~worse
        p, a, b = particle[kept], first[kept], second[kept]
        current[a, p], current[b, p] = current[b, p], current[a, p]
        order[a, p], order[b, p] = order[b, p], order[a, p]
    return order


def order_by_springs(model: Model, ends: SpringEnds) -> NDArray[np.int64]:
    """Return the particles of each balloon by their number of springs of each kind."""
    structural, shear, flexion = ends.by_kind.T
    return np.lexsort([flexion, shear, structural, model.particle_balloon.numpy()])


def renumbered(model: Model, order: NDArray[np.int64]) -> Model:
    """Return the model whose particle at each place is that of the order, shape (particle_count,).

    Particles of a balloon must stay together. Only the shapes' meshes take that order: membranes and hinges do not.
    """
    places = np.argsort(order)
    offsets = np.asarray(model.particle_face_offsets.numpy(), dtype=np.int64)
    around = np.split(np.asarray(model.particle_faces.numpy()), offsets[1:-1])
    shapes = []
    for shape, first in zip(model.shapes, model.particle_offsets, strict=False):
        mesh = shape.mesh
        own = order[first : first + mesh.vertex_count] - first
        indices = np.argsort(own)[mesh.face_vertex_indices].astype(mesh.face_vertex_indices.dtype)
        shapes.append(replace(shape, mesh=replace(mesh, points=mesh.points[own], face_vertex_indices=indices)))

    def array(like: wp.array, values: Any) -> wp.array:
        return wp.array(np.ascontiguousarray(values), dtype=like.dtype, device=model.device)

    def of_particles(values: wp.array) -> wp.array:
        return array(values, values.numpy()[order]) if values.size else values

    def to_particles(particles: wp.array) -> wp.array:
        numbers = np.asarray(particles.numpy(), dtype=np.int64)
        return array(particles, places[numbers].astype(np.int32)) if particles.size else particles

    return replace(
        model,
        shapes=shapes,
        initial_points=of_particles(model.initial_points),
        particle_mass_share=of_particles(model.particle_mass_share),
        particle_face_offsets=array(model.particle_face_offsets, np.cumsum([0, *(len(around[p]) for p in order)])),
        particle_faces=array(model.particle_faces, np.concatenate([around[p] for p in order])),
        face_particles=to_particles(model.face_particles),
        spring_particles=to_particles(model.spring_particles),
        string_particle=to_particles(model.string_particle),
        driven=model.driven._replace(particles=places[model.driven.particles]),
        neck_weights=of_particles(model.neck_weights),
        neck_edges=to_particles(model.neck_edges),
    )


def kind_slots(ends: SpringEnds) -> tuple[int, int, int]:
    """Return the most springs of each kind at a particle."""
    structural, shear, flexion = ends.by_kind.max(axis=0).tolist()
    return structural, shear, flexion


def slot_table(model: Model, ends: SpringEnds, ring: Ring | None = None) -> Any:
    """Return the table; slots that are left over hold a spring of no stiffness from the particle to itself.

    Args:
        ring: in which structural and shear springs go around each particle, where that matters.
    """
    neighbors, scales, rest_lengths = (
        np.concatenate(parts)
        for parts in zip(
            *(_slots_of_kind(ends, kind, ring[kind] if ring and kind < 2 else None) for kind in range(3)), strict=True
        )
    )

    def array(values: NDArray, dtype: Any) -> Any:
        return wp.array(values, dtype=dtype, device=model.device)

    table = SlotTable()
    table.neighbors = array(neighbors, wp.int32)
    table.scales = array(scales, float)
    table.rest_lengths = array(rest_lengths, float)
    table.valences = array(ends.by_kind[:, 0], wp.int32)
    return table


def slot_pairs(table: Any) -> wp.array:
    """Return the neighbors of a table, by their bits, and its rest lengths, in one place, where all scales are 1.

    Array of wp.vec2 of shape (slot_count, particle_count).
    """
    neighbors, lengths = table.neighbors.numpy(), table.rest_lengths.numpy()
    pairs = np.stack([neighbors.astype(np.int32).view(np.float32), lengths], axis=-1)
    return wp.array(pairs, dtype=wp.vec2, device=table.neighbors.device)


def _slots_of_kind(ends: SpringEnds, kind: int, ring: NDArray[np.int64] | None) -> tuple[NDArray, NDArray, NDArray]:
    """Return the neighbors, scales and rest lengths, each of shape (slot_count, particle_count)."""
    counts = ends.by_kind[:, kind]
    shape = counts.max(), len(counts)
    of_kind = ends.kind == kind
    particle = ends.particle[of_kind]
    slot = np.arange(len(particle)) - np.repeat(np.cumsum(counts) - counts, counts)
    neighbors = np.repeat(np.arange(shape[1])[None], shape[0], axis=0)
    scales, rest_lengths = np.zeros(shape), np.zeros(shape)
    neighbors[slot, particle] = ends.neighbor[of_kind]
    scales[slot, particle] = ends.scale[of_kind]
    rest_lengths[slot, particle] = ends.rest_length[of_kind]
    order = spread_over_banks(neighbors) if ring is None else _in_ring(neighbors, ring)
    return (
        np.take_along_axis(neighbors, order, axis=0),
        np.take_along_axis(scales, order, axis=0),
        np.take_along_axis(rest_lengths, order, axis=0),
    )


def _in_ring(neighbors: NDArray[np.int64], ring: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the order of each particle's slots that follows the ring, shape (slot_count, particle_count).

    Neighbors that are not in the ring come last.
    """
    order = np.repeat(np.arange(len(neighbors))[:, None], neighbors.shape[1], axis=1)
    for particle, around in enumerate(ring.T):
        wanted = around[around >= 0]
        place = {neighbor: slot for slot, neighbor in enumerate(neighbors[: len(wanted), particle].tolist())}
        order[: len(wanted), particle] = [place[neighbor] for neighbor in wanted.tolist()]
    return order
