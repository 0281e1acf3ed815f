"""Lists of contacts: how long they are, and how they grow where a frame has found no room in one.

A frame that has found none is computed again from its start, with longer lists, so that the motion of a world
depends neither on their length, nor on the worlds beside it that have made them grow.
"""

import math
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import warp as wp

from balloon_warp.kernels.contact.contact import Contact
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.tables import HEALTHY
from balloon_warp.kernels.working import LISTS
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.model import Model, State, overwrite
from balloon_warp.model.state import Allocating, Counting, Room, new_state, usable_memory
from balloon_warp.model.touch import meeting_edges

TRIANGLES = 40
"""Least number of triangles of a particle for which there is room"""
PAIRS_OF_EDGE, TRIANGLES_OF_EDGE = 24, 24
"""Pairs of edges that may touch until the next search for which there is room, for each edge, and triangles of a
particle among them"""
LISTED_CONTACTS, MAX_LISTED_CONTACTS, ROOMY = 8, 32, 32_768
"""Number of pairs that a world has room for in a substep, for each edge: in a packet of layers all of its edges, and
particles, are near many others, and so a world has room for all that may be listed, up to `ROOMY` pairs"""
LEAST_RIDGE_PAIRS, RIDGE_PAIRS = 1024, 2
"""Least number of pairs of ridges that a world has room for, and number for each triangle and edge of its balloons"""
GROWTH, ROUNDED = 1.5, 8
"""Length of a list that grows, over the one that it has needed, so that it seldom grows, and its divisor"""
ARRAYS: dict[str, Any] = {
    "candidates": wp.int32,
    "edge_pairs": wp.vec3i,
    "listed_contacts": Contact,
    "ridge_pairs": wp.vec3i,
}
"""Lists of `Working` and their types, in the order of `kernels.working`"""


class ContactLists:
    """Lists of contacts of a schedule's launches, and the start of the frame in which they may have to grow."""

    def __init__(self, model: Model, features: Features, working: Any):
        self._model, self._features, self._working = model, features, working
        self._start, self._ages = start_of_frame(model, Allocating(model.device))
        self.ignored = 0
        """Number of contacts in all worlds that were ignored, since lists had no place for them and could not grow"""

    def begin(self, state: State) -> None:
        """Keep the state with which a frame begins."""
        overwrite(self._start, state)
        if self._model.ages is not None:
            wp.copy(self._ages, self._model.ages)

    def put_back(self, state: State) -> None:
        """Go back to where the frame began."""
        overwrite(state, self._start)
        if self._model.ages is not None:
            wp.copy(self._model.ages, self._ages)

    def grow(self, state: State) -> bool:
        """Make lists longer that the frame has found too short, and return whether there were any.

        Those of worlds that have blown up do not count: there everything is near everything. Where memory does not
        suffice, nothing grows, and ignored contacts are counted.
        """
        working = self._working
        needs = np.asarray(working.needs.numpy())
        if not needs.any():
            return False
        healthy = np.asarray(state.first_bad.numpy()) == HEALTHY
        needed, ignored = needs[healthy].max(axis=0, initial=0), int(working.overflow.numpy()[healthy].sum())
        working.needs.zero_()
        working.overflow.zero_()
        longer = {name: int(need) for name, need in zip(ARRAYS, needed, strict=True) if need > 0}
        if longer and self._make_longer(longer):
            return True
        self.ignored += ignored
        return False

    def _make_longer(self, needed: Mapping[str, int]) -> bool:
        model, grown = self._model, self._model.contact_room
        before = dict(grown)
        for name, need in needed.items():
            length = ROUNDED * math.ceil(GROWTH * need / ROUNDED)
            grown[name] = max(length, grown.get(name, 0))
        list_arrays(model, self._features, counted := Counting(), needed)
        if counted.bytes > usable_memory(model.device):
            grown.clear()
            grown.update(before)
            return False
        for name, array in list_arrays(model, self._features, Allocating(model.device), needed).items():
            setattr(self._working, name, array)
        return True


def has_lists(features: Features) -> bool:
    """Return whether launches list contacts."""
    return features.touches or features.lists_contacts


def start_of_frame(model: Model, room: Room) -> tuple[State, Any]:
    """Return memory for the state and the times of worlds as a frame begins."""
    return new_state(model, room), room.array(model.world_count, wp.int32)


def list_arrays(
    model: Model, features: Features, room: Room, names: Iterable[str] = tuple(ARRAYS)
) -> dict[str, wp.array]:
    """Return the arrays of `Working` for lists of contacts; empty where a scene does not need them."""
    rows = {"candidates": (model.particle_count if features.touches else 0,)}
    lengths = list_lengths(model, features)
    return {name: room.array((model.world_count, *rows.get(name, ()), lengths[name]), ARRAYS[name]) for name in names}


def counting_arrays(model: Model, features: Features, room: Room) -> dict[str, wp.array]:
    """Return the arrays of `Working` that tell of lists without room."""
    worlds = model.world_count if has_lists(features) else 0
    return {"overflow": room.array(worlds, wp.int32), "needs": room.array((worlds, LISTS), wp.int32)}


def list_lengths(model: Model, features: Features) -> dict[str, int]:
    """Return the lengths of lists, of a particle or a world: as at first, or grown."""
    first = first_lengths(model, features)
    return {name: max(length, model.contact_room.get(name, 0)) if length else 0 for name, length in first.items()}


def first_lengths(model: Model, features: Features) -> dict[str, int]:
    """Return the lengths of lists before any has grown; 0 of those that a scene does not need."""
    edges = edge_count(model, features)
    ridges = max(LEAST_RIDGE_PAIRS, RIDGE_PAIRS * _feature_count(model)) if features.ridges else 0
    beside_bodies = model.particle_count if features.bodies else 0
    return {
        "candidates": TRIANGLES if features.touches else 0,
        "edge_pairs": edges * PAIRS_OF_EDGE + (model.particle_count * TRIANGLES_OF_EDGE if edges else 0),
        "listed_contacts": max(LISTED_CONTACTS * edges, min(MAX_LISTED_CONTACTS * edges, ROOMY), ridges, beside_bodies),
        "ridge_pairs": ridges,
    }


def edge_count(model: Model, features: Features) -> int:
    """Return the number of edges of a world that may meet others."""
    return sum(map(len, meeting_edges(model.scene, model.shapes))) if features.edges_meet else 0


def _feature_count(model: Model) -> int:
    """Count triangles and edges of closed meshes."""
    return sum(_most_features(shape.mesh) for shape in model.shapes)


def _most_features(mesh: PolygonMesh) -> int:
    triangles = int(np.maximum(mesh.face_vertex_counts - 2, 0).sum())
    return triangles + (3 * triangles + 1) // 2


def overflow_remarks(overflow: int) -> list[str]:
    """Return the warning for a number of contacts that were ignored."""
    if not overflow:
        return []
    return [
        f"touch: contacts were too crowded {overflow:,} times and some were ignored; fewer worlds, "
        "coarser meshes or more substeps help"
    ]


MANY = 500_000
"""Number of particles in all worlds above which they take a GPU several times as long as one more launch"""
ENOUGH_THREADS = 262_144
"""Number of threads that keep a GPU busy"""
MOST_AT_ONCE = 65_536
"""Number of threads that a GPU has at once, where each takes many registers, or more"""
FEW_THREADS = 64
"""Threads of a block, where each takes many registers"""


def has_many(model: Model) -> bool:
    """Return whether a GPU takes much longer for all particles than for a launch."""
    return model.device.is_cuda and model.world_count * model.particle_count >= MANY


def threads_of_list(model: Model) -> int:
    """Return the number of threads that loop over a list of a world's particles.

    On a GPU whole blocks, for an eighth of all, or for all where worlds are few.
    """
    if not model.device.is_cuda:
        return 1
    wanted = max(model.particle_count // 8, min(ENOUGH_THREADS // model.world_count, model.particle_count))
    return -(-wanted // FEW_THREADS) * FEW_THREADS
