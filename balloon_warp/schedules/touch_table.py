"""Surfaces of balloons that touch, ridges, bodies and spheres, as kernels read them; and the lists of their contacts.

Small spheres touch faces, and not only particles, one by one; larger ones as ridges do.

Lists grow where a frame has found no room in one. It is computed again from its start, with longer lists, so that the
motion of a world depends neither on their length, nor on the worlds beside it that have made them grow.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import cache
from math import ceil
from typing import Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.kernels.contact.contact import Contact
from balloon_warp.kernels.contact.spheres import MOST_IN_LUMP
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.law import FAR
from balloon_warp.kernels.laws.rigid import Grip
from balloon_warp.kernels.laws.touch import Ridge
from balloon_warp.kernels.tables import HEALTHY, RidgeTable, TouchTable
from balloon_warp.kernels.working import LISTS
from balloon_warp.mesh.orientation import triangles_of
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.model import Model, State, overwrite
from balloon_warp.model.obstacles import max_body_contacts
from balloon_warp.model.parameters import values_over_time
from balloon_warp.model.stability import held_within, widest_opening
from balloon_warp.model.state import Allocating, Counting, Room, new_state, usable_memory
from balloon_warp.model.touch import (
    APART,
    NO_RIDGES,
    STIFFNESSES,
    THICKNESS,
    Ridges,
    contacts_per_particle,
    edge_length,
    edges_by_leaf,
    is_folded,
    is_stacked,
    kept_distance,
    meeting_edges,
)


def small_spheres(model: Model) -> list[bool]:
    """Return whether each sphere also touches faces, since it may fit through one, in any world at any time."""
    scene = model.scene
    if not scene.touches_spheres:
        return [False] * len(scene.sphere)
    most = held_within(scene) * max(widest_opening(shape.mesh) for shape in model.shapes)
    return [bool(radius < most) for radius in _min_radii(model)]


def round_ridges(model: Model) -> list[bool]:
    """Return whether each sphere touches faces as ridges do: it is not small, and exchanges momentum.

    So it is where faces meet ridges, of solids that are thin beside them, or the scene says `faces = true`.
    """
    scene = model.scene
    if not scene.touches_spheres or scene.contact != "impulse":
        return [False] * len(scene.sphere)
    meets = scene.faces is True or model.faces_meet
    return [meets and not small for small in small_spheres(model)]


def _min_radii(model: Model) -> NDArray[np.float64]:
    """Return the least radius of each sphere, in any world at any time, once it is there [m]."""
    spheres = model.scene.sphere
    radii = np.concatenate([rows.reshape(-1, len(spheres)) for rows in values_over_time(model, "sphere_radius")])
    said = np.array([sphere.radius for sphere in spheres])
    return np.where(radii > 0.0, radii, said).min(axis=0)


def without_small_spheres(model: Model) -> Model:
    """Return a model to which small spheres may be added, and touch no faces.

    It is the same model if it has some that do. They would take all of it to a slower schedule, in which a replay would
    be from the start.
    """
    touch = model.scene.touch
    meet_already = model.faces_meet or any(small_spheres(model)) or any(round_ridges(model))
    if meet_already or (touch and not (touch.balloons or touch.itself)):
        return model
    without = {"faces": False, "touch": touch.model_copy(update={"spheres": False}) if touch else touch}
    return replace(model, scene=model.scene.model_copy(update=without))


def solid_arrays(model: Model, features: Features, room: Room) -> dict[str, Any]:
    """Return the arrays of `Working` for bodies and colliding spheres; empty where a scene does not need them."""
    worlds = model.world_count
    bodies = model.body_count if features.bodies else 0
    particles = model.particle_count
    return {
        "sphere_starts": room.array((worlds, model.sphere_count if features.keeps_starts else 0), wp.vec3),
        "body_starts": room.array((worlds, bodies), wp.vec3),
        "body_start_turns": room.array((worlds, bodies), wp.quat),
        "body_masses": room.array((worlds, bodies), wp.float32),
        "body_inverse_inertias": room.array((worlds, bodies), wp.mat33d),
        "body_going": room.array((worlds, bodies), wp.vec3d),
        "body_turning": room.array((worlds, bodies), wp.vec3d),
        "body_quanta": room.array((worlds, bodies if features.bodies_take_forces else 0, 3), wp.int64),
        "body_turning_quanta": room.array((worlds, bodies if features.bodies_take_forces else 0, 3), wp.int64),
        "body_tugs": room.array((worlds, bodies if features.ties else 0), wp.vec3),
        "body_twists": room.array((worlds, bodies if features.ties else 0), wp.vec3),
        "body_groups": room.array((worlds, bodies), wp.int32),
        "body_gains": room.array((worlds, bodies), wp.vec4d),
        "grips": room.array((worlds, max_body_contacts(model.bodies) if bodies else 0), Grip),
        "point_starts": room.array((worlds, particles if features.small_spheres else 0), wp.vec3),
        "merged": room.array((worlds, int(MOST_IN_LUMP) if features.small_spheres else 0), wp.int32),
    }


MARGIN = 0.15
"""Distance within which ridges are listed until the next search, over an edge"""
CENTER = Ridges(np.zeros((1, 2, 3)), np.zeros((1, 2, 3)), 0.0, np.ones(1, np.int32))
"""Ridge of a sphere, whose radius is the sphere's in a world"""


def ridge_table(model: Model, features: Features) -> Any:
    """Make the table of ridges; empty where faces do not meet any. Its trees live as long as the model does."""
    table, device = RidgeTable(), model.device
    if not features.ridges:
        return table
    solids = len(model.obstacles) + len(model.bodies)
    spheres = [CENTER if is_round else NO_RIDGES for is_round in round_ridges(model)]
    ridges = [*(model.ridges or [NO_RIDGES] * solids), *spheres]
    trees = [tree.id if tree else 0 for tree in model.ridge_trees] or [0] * solids
    firsts = np.cumsum([0, *(len(each.ends) for each in ridges)])
    table.ridges = wp.array([row for each in ridges for row in _rows(each)], dtype=Ridge, device=device)
    table.ends = wp.array(np.stack([firsts[:-1], firsts[1:]], axis=1), dtype=wp.vec2i, device=device)
    table.boxes = wp.array([_box_of(each) for each in ridges], dtype=wp.vec3, device=device)
    table.trees = wp.array([*trees, *(0 for _ in spheres)], dtype=wp.uint64, device=device)
    table.features = wp.array(_features_of(model), dtype=wp.vec4i, device=device)
    edge = min(edge_length(shape.mesh) for shape in model.shapes)
    table.kept, table.margin = kept_distance(model.shapes), MARGIN * edge
    return table


def ridge_arrays(model: Model, features: Features, room: Room) -> dict[str, Any]:
    """Return the arrays of `Working` for ridges, but for lists that grow; empty where faces do not touch them."""
    worlds = model.world_count if features.ridges else 0
    spheres = model.sphere_count if features.round_ridges else 0
    return {
        "ridge_counts": room.array((worlds,), wp.int32),
        "ridge_budgets": room.array((worlds,), wp.float32),
        "ridge_radii": room.array((worlds, spheres), wp.float32),
    }


def sweep_arrays(model: Model, features: Features, room: Room) -> dict[str, Any]:
    """Return the arrays of `Working` for sweeps over contacts, but for their list; empty where there are none."""
    worlds = model.world_count if features.lists_contacts else 0
    solids = model.body_count + (model.sphere_count if features.ridges else 0)
    tells = features.tells_contacts and features.edges_meet
    return {
        "listed_contact_counts": room.array((worlds, 2), wp.int32),
        "contact_shares": room.array((worlds, model.particle_count), wp.int32),
        "contact_quanta": room.array((worlds, model.particle_count, 3), wp.int64),
        "layer_quanta": room.array((worlds, model.particle_count if tells else 0, 3), wp.int64),
        "contact_stops": room.array((worlds, 0), wp.vec2),
        "solid_shares": room.array((worlds, solids), wp.int32),
        "solid_quanta": room.array((worlds, solids, 6), wp.int64),
    }


def _rows(ridges: Ridges) -> list[Any]:
    rows = []
    for (begin, end), (inward, other), tips in zip(ridges.ends, ridges.inward, ridges.tips, strict=True):
        row = Ridge()
        row.begin, row.end = wp.vec3(begin), wp.vec3(end)
        row.inward, row.other_inward = wp.vec3(inward), wp.vec3(other)
        row.radius, row.tips = ridges.radius, int(tips)
        rows.append(row)
    return rows


def _box_of(ridges: Ridges) -> NDArray[np.float64]:
    """Return the box around a solid's ridges, shape (2, 3); an empty one where it has none."""
    points = np.asarray(ridges.ends, dtype=float).reshape(-1, 3)
    lower, upper = points.min(axis=0, initial=FAR), points.max(axis=0, initial=-FAR)
    return np.stack([lower - ridges.radius, upper + ridges.radius])


def _features_of(model: Model) -> NDArray[np.int32]:
    """Return the triangles and edges of all balloons."""
    offsets = model.particle_offsets
    rows = []
    for number, shape in enumerate(model.shapes):
        triangles = triangles_of(shape.mesh)
        edges = np.unique(
            np.sort(np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=-1).reshape(-1, 2)), axis=0
        )
        edges = edges[edges[:, 0] != edges[:, 1]]
        first, none = int(offsets[number]), np.full((len(edges), 1), -1)
        rows.append(np.column_stack([triangles + first, np.full(len(triangles), number)]))
        rows.append(np.column_stack([edges + first, none, np.full(len(edges), number)]))
    return np.concatenate(rows).astype(np.int32)


SEARCH_SECONDS = 1.0 / 240.0
"""Time between two searches [s]: balloons that approach at 10 m/s come 4 cm nearer meanwhile. In twice the time lists
are long where balloons fall into a box, as in `balloon_pit`"""
FOLDED_SECONDS = 1.0 / 300.0
"""Time between two searches of a balloon that is folded, of two layers, as flat foil is [s]: in a longer one lists
are long where that fills"""
LEAST_SUBSTEPS, LEAST_SUBSTEPS_ITSELF = 2, 4
"""Least number of substeps between two searches; more where every particle has to search its own balloon, which takes
as long as five substeps"""
SLACK = 0.1
"""Distance that each of two particles may gain between two searches by accelerating, over an edge"""
FOLDED_SLACK = 0.02
"""Slack in a balloon that is folded at the start: with more, more layers are near a particle"""
ITSELF = 1e-5
"""Initial distance from which on parts of a folded balloon may touch, in edges: a particle does not touch its own
triangles"""
DEPTH = 0.25
"""Depth down to which particles inside are pushed out, over the least initial extent of a balloon; foil, which is flat
then, pushes as deep as an edge is long"""
FLAT = 0.999
"""Least initial extent of a balloon below which it is flat, over an edge: a cube of one quad a side is not, wherever"""
ROUNDING = 2.0**20
"""Number of places that are told apart along a mesh, as it is cut into parts"""
TRIANGLES_OF_LEAF = 8
"""Largest number of triangles of a leaf: a CPU compares as many boxes at once"""


def touch_table(model: Model, features: Features) -> Any:
    """Return the balloons' surfaces; empty where none touch."""
    table = TouchTable()
    if not features.touches:
        return table
    shapes, offsets = model.shapes, model.particle_offsets
    surfaces = [surface_of(shape.mesh) for shape in shapes]
    triangles = [surface.triangles + first for surface, first in zip(surfaces, offsets[:-1], strict=True)]
    first_triangles = np.cumsum([0, *(len(surface.triangles) for surface in surfaces)])
    ranges = [surface.leaves + first for surface, first in zip(surfaces, first_triangles[:-1], strict=True)]
    own_triangles = np.concatenate(ranges)
    edges = np.array([edge_length(shape.mesh) for shape in shapes])

    def array(values: Any, dtype: Any) -> wp.array:
        return wp.array(np.asarray(values), dtype=dtype, device=model.device)

    corners = np.concatenate(triangles)
    table.triangles = array(corners, wp.vec3i)
    own_particles = [np.unique(corners[begin:end]) for begin, end in own_triangles]
    places = np.cumsum([0, *map(len, own_particles)])
    table.particles = array(np.concatenate(own_particles), wp.int32)
    table.leaf_particles = array(np.stack([places[:-1], places[1:]], axis=1), wp.vec2i)
    table.balloon_leaves = array(np.cumsum([0, *map(len, ranges)]), wp.int32)
    table.closed = array([shape.closed for shape in shapes], wp.int32)
    table.thickness = array(THICKNESS * edges, float)
    folded = [features.touches_itself and is_folded(shape.mesh) for shape in shapes]
    table.slack = array(np.where(folded, FOLDED_SLACK, SLACK) * edges, float)
    table.depth = array([depth_of(shape.mesh) for shape in shapes], float)
    table.crowd = array(
        [contacts_per_particle(shapes, number, features.touches_itself) for number in range(len(shapes))], float
    )
    table.stiffness = model.parameters[STIFFNESSES]
    leaves = np.repeat(np.arange(len(own_triangles)), np.diff(own_triangles, axis=1)[:, 0])
    homes = np.repeat(table.balloon_leaves.numpy()[:-1], np.diff(offsets))
    homes[corners] = leaves[:, None]
    order = np.argsort(homes, kind="stable")
    table.homes = array(np.stack([order, homes[order]], axis=1), wp.vec2i)
    bounds = np.zeros(len(own_triangles) + 1, dtype=np.int64)
    if features.edges_meet:
        own_edges = meeting_edges(model.scene, shapes)
        ends = np.concatenate([own + first for own, first in zip(own_edges, offsets[:-1], strict=True)])
        ends, edge_homes = edges_by_leaf(corners, leaves, ends)
        table.edges, table.edge_homes = array(ends, wp.vec2i), array(edge_homes, wp.int32)
        bounds = np.searchsorted(edge_homes, np.arange(len(bounds)))
    table.leaves = array(np.column_stack([own_triangles, bounds[:-1], bounds[1:]]), wp.vec4i)
    rest, boxes = np.zeros((0, 3)), np.zeros((0, 2, 3))
    if features.touches_itself:
        rest = np.concatenate([shape.mesh.points for shape in shapes])
        parts = [rest[corners[begin:end]].reshape(-1, 3) for begin, end in own_triangles]
        boxes = np.array([(part.min(axis=0, initial=FAR), part.max(axis=0, initial=-FAR)) for part in parts])
    table.rest_points = array(rest, wp.vec3)
    table.rest_boxes = wp.array(boxes.reshape(-1, 2, 3), dtype=wp.vec3, device=model.device)
    table.apart = array(np.where(folded, ITSELF, APART) * edges, float)
    table.seconds = substeps_of_search(model) * model.step_seconds
    return table


def depth_of(mesh: PolygonMesh) -> float:
    """Return the depth down to which a balloon pushes out particles inside [m], which does not depend on its place."""
    edge = edge_length(mesh)
    extent = float(np.ptp(mesh.points[mesh.face_vertex_indices], axis=0).min())
    return edge if extent < FLAT * edge else DEPTH * extent


class Surface(NamedTuple):
    """A mesh as a tree of parts, each halved across its longest extent; numbers count from the mesh's first."""

    triangles: NDArray[np.int64]
    """Vertices of the triangles, shape (T, 3)"""
    ranges: NDArray[np.int64]
    """Begin and end of each part's triangles, shape (parts, 2)"""
    ends: NDArray[np.int64]
    """Next part outside of each part's subtree, shape (parts,)"""

    @property
    def leaves(self) -> NDArray[np.int64]:
        """Begin and end of the triangles of each leaf, shape (leaves, 2)."""
        return self.ranges[self.ends == np.arange(len(self.ends)) + 1]


def surface_of(mesh: PolygonMesh) -> Surface:
    """Return the mesh's triangles, part by part; each part is followed by those in it."""
    triangles = triangles_of(mesh)
    centers = _rounded(mesh.points[triangles].mean(axis=1))
    order = np.arange(len(triangles))
    ranges, depths, waiting = [], [], [(0, len(triangles), 0)]
    while waiting:
        begin, end, depth = waiting.pop()
        ranges.append((begin, end))
        depths.append(depth)
        if end - begin > TRIANGLES_OF_LEAF:
            own = order[begin:end]
            axis = int(np.ptp(centers[own], axis=0).argmax())
            order[begin:end] = own[np.argsort(centers[own, axis], kind="stable")]
            middle = (begin + end) // 2
            waiting += [(middle, end, depth + 1), (begin, middle, depth + 1)]
    ends, after = np.empty(len(depths), dtype=np.int64), {}
    for part in reversed(range(len(depths))):
        # a next one that is no deeper is not in it
        ends[part] = min((after[d] for d in range(depths[part] + 1) if d in after), default=len(depths))
        after = {d: p for d, p in after.items() if d < depths[part]} | {depths[part]: part}
    return Surface(triangles[order], np.array(ranges), ends)


def _rounded(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return places in a mesh that are alike wherever it is: a world of a batch has the tree that it has alone."""
    if not len(points):
        return points
    lower = points.min(axis=0)
    return np.round((points - lower) * (ROUNDING / max(float((points - lower).max()), 1e-30)))


def leaf_count(mesh: PolygonMesh) -> int:
    """Return the leaves that a mesh has, without looking for them."""
    return _leaves_of(int(np.maximum(mesh.face_vertex_counts - 2, 0).sum()))


@cache
def _leaves_of(triangles: int) -> int:
    half = triangles // 2
    return 1 if triangles <= TRIANGLES_OF_LEAF else _leaves_of(half) + _leaves_of(triangles - half)


def substeps_of_search(model: Model) -> int:
    """Return the substeps from one search to the next."""
    least = LEAST_SUBSTEPS_ITSELF if model.scene.touches_itself else LEAST_SUBSTEPS
    folded = [shape.mesh for shape in model.shapes if model.scene.touches_itself and is_folded(shape.mesh)]
    if any(is_stacked(mesh) for mesh in folded):
        return least  # layers go by each other
    if folded:
        return max(ceil(FOLDED_SECONDS / model.step_seconds), least)
    return max(int(SEARCH_SECONDS / model.step_seconds), least)


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
