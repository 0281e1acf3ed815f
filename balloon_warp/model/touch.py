"""Contact between balloons as a simulation starts: thickness and stiffness, self-contact, folds, and crossings.

Ridges of obstacles and bodies, and edges of balloons, that touch between particles.

Ridges of obstacles and free bodies, which balloon faces touch between their particles.

Ridges are the convex edges of boxes and meshes, and the axes of capsules.
"""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any, Literal, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.kernels.laws.springs import KINDS
from balloon_warp.kernels.laws.touch import DAMPING_RATIO
from balloon_warp.mesh.crossings import find_crossings
from balloon_warp.mesh.orientation import triangles_of
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.thickness import length_graph, nears_itself, slenderness
from balloon_warp.mesh.topology import corner_faces, face_vector_areas, mesh_edges, next_corners
from balloon_warp.model.materials import Bound
from balloon_warp.model.obstacles import BodyShape, ObstacleShape, is_thin, obstacle_motion
from balloon_warp.model.parameters import Parameters
from balloon_warp.model.shape import BalloonShape
from balloon_warp.model.starts import start_of, starts_pressed
from balloon_warp.scene import Balloon, Scene, Touch

THICKNESS = 0.05
"""Thickness of a balloon's skin over an edge of its mesh: a hundredth of a sphere's radius, which is invisible"""
STIFFNESS = 0.25
"""Contact stiffness over the sum of a particle's springs: a sphere stretched by a quarter is then indented by less than
the skin's thickness where it lies against another, and the step becomes a quarter shorter"""
SOFTER = 0.45
"""Contact stiffness over that, of a balloon alone that touches itself softly: its step is then hardly shorter"""
APART = 2.0
"""Initial distance from which on parts of a balloon may touch, in edges: farther than neighbors, nearer than
parts that a sharp fold brings together"""
LOOSE_RATE = 600.0
"""Root of stiffness over mass of a balloon without springs [1/s]"""
STIFFNESSES = "touch_stiffnesses"
"""Name of each balloon's contact stiffness in the parameters, shape (W, balloon_count) [N/m]"""


def resolve_touch(scene: Scene, shapes: Sequence[BalloonShape], parameters: Parameters) -> Parameters:
    """Return each balloon's default contact stiffness; empty where no balloons touch."""
    if not scene.touches:
        return {}
    share = stiffness_share(scene)
    columns = [_own_stiffness(shape, number, parameters, share) for number, shape in enumerate(shapes)]
    return {STIFFNESSES: np.stack(np.broadcast_arrays(*columns), axis=1)}


def stiffness_share(scene: Scene) -> float:
    """Return the contact stiffness over the sum of a particle's springs."""
    softly = scene.touches_softly and len(scene.balloon) == 1
    return STIFFNESS * (SOFTER if softly else 1.0)


def _own_stiffness(shape: BalloonShape, number: int, parameters: Parameters, share: float) -> NDArray[np.float64]:
    """Return the stiffness at a balloon's mean moving particle, shape (W,)."""
    moving = max(int(np.count_nonzero(shape.mass_share)), 1)
    total: Any = 0.0
    for kind, row in enumerate(KINDS):
        scales = float(shape.stiffness_scale[shape.springs.kind == kind].sum())
        total = total + 2.0 * scales / moving * parameters[row.name][:, number]
    loose = parameters["mass"][:, number] / moving * LOOSE_RATE**2
    return np.where(total > 0.0, share * total, loose)


def edge_length(mesh: PolygonMesh) -> float:
    """Return the mean length of a mesh's edges [m]."""
    ends = mesh.points[mesh_edges(mesh).ends]
    return float(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).mean())


def contacts_per_particle(shapes: Sequence[BalloonShape], number: int, itself: bool) -> float:
    """Return the number of contacts on a particle of a balloon where even surfaces lie on each other.

    Its own, and as a corner of triangles those of others, as many as fit into its share of the surface.
    """
    counts = np.array([shape.mesh.vertex_count for shape in shapes])
    areas = np.array([shape.area for shape in shapes]) / counts
    crowds = np.clip(areas[number] / np.maximum(areas, 1e-30), 1.0, counts)
    return 1.0 + float(np.max(crowds[_met_by(number, len(shapes), itself)]))


def _met_by(number: int, count: int, itself: bool) -> NDArray[np.bool_]:
    """Return a mask of the balloons that one may touch."""
    return (np.arange(count) != number) | itself


def bound_of_touch(
    scene: Scene, shapes: Sequence[BalloonShape], number: int, parameters: Parameters
) -> dict[Bound, NDArray[np.float64]]:
    """Return the contribution of contacts to stiffness [N/m] and drag [N s/m] at each particle, for the stable step.

    As in `Bounds.sums`, of which twice is over the mass; shape (W,). Empty where no balloons touch. Drag is that of a
    particle with all of the balloon's mass, and goes with the root of a particle's share: the reduced mass, which
    damps a contact, is at most a particle's own.

    A particle meets a surface, and is a corner of triangles that others meet: as many as fit into its share of the
    surface. When two surfaces move against each other, all of that pulls it back, twice; and then their springs rest.
    While springs are at their stiffest, neighbors go opposite ways, and the load of a triangle's corners is evened out:
    it counts half. Where contacts are stiffer than springs, they set the step alone. Where more meet than that, as in
    crumpled skin, they share (`share_of_contact`), so that the step is stable in every state.
    """
    if not scene.touches:
        return {}
    said, own = parameters["touch_stiffness"], parameters[STIFFNESSES]
    crowd = contacts_per_particle(shapes, number, scene.touches_itself)
    mass = parameters["mass"][:, number]
    others = own[:, _met_by(number, len(shapes), scene.touches_itself)]
    between = 2.0 * own[:, number, None] * others / (own[:, number, None] + others)
    each = np.where(said < 0.0, between.max(axis=1), said)
    both = crowd * each
    stiffness = 0.5 * (both + np.maximum(both - own[:, number] / stiffness_share(scene), 0.0))
    return {"stiffness": stiffness, "drag": crowd * float(DAMPING_RATIO) * np.sqrt(each * mass)}


DETOUR = 1.2
"""Least length of the way along the surface, over the distance below which particles are near each other in space, of
such that show that a surface is folded: along edges and diagonals, a flat one has ways up to 1.16"""
LAYERS = 2.5
"""Number of layers above which a surface is stacked, by how many particles they have"""
NARROW = 0.5
"""Distance between layers that lie on each other, over the mean edge: triangles have no such detours between them"""
HOPS = 2
"""Number of edges or diagonals that lead to all that is near in an even mesh"""
ROWS = 256
"""Number of particles whose ways are measured together, to bound the memory, and at most to find layers"""


def bends_freely(balloon: Balloon) -> bool:
    """Return whether nothing of a balloon's skin resists bending."""
    material, stiffness = balloon.material, balloon.stiffness
    stiff = "flexion" in material.springs if material.is_membrane else stiffness.flexion > 0.0
    return not stiff and not stiffness.torsion > 0.0


def is_stacked(mesh: PolygonMesh) -> bool:
    """Return whether more than two layers of a surface lie on each other, as they do not in flat foil.

    Looks where most is near: how much of that is near along the surface, too, is one layer.
    """
    from scipy.sparse.csgraph import dijkstra  # takes long to load
    from scipy.spatial import KDTree

    apart = APART * edge_length(mesh)
    used = np.unique(mesh.face_vertex_indices)
    points = mesh.points[used]
    tree = KDTree(points)
    fullest = np.argsort(-tree.query_ball_point(points, apart, return_length=True), kind="stable")[:ROWS]
    ways = dijkstra(length_graph(mesh), indices=used[fullest], limit=DETOUR * apart)[:, used]
    around = tree.query_ball_point(points[fullest], apart)
    return any(len(near) > LAYERS * np.isfinite(way[near]).sum() for near, way in zip(around, ways, strict=True))


def is_in_layers(mesh: PolygonMesh) -> bool:
    """Return whether layers of a surface lie on each other: nearer than half an edge, and far along it."""
    return is_folded(mesh, NARROW * edge_length(mesh))


def is_folded(mesh: PolygonMesh, nearer: float | None = None) -> bool:
    """Return whether parts of a surface are near each other, and far along it.

    Args:
        nearer: distance that counts as near [m]; that within which particles count as neighbors, if not given.
    """
    from scipy.sparse.csgraph import dijkstra  # takes long to load
    from scipy.spatial import KDTree

    apart = APART * edge_length(mesh)
    graph = length_graph(mesh)
    hops = graph.astype(bool)
    for _ in range(HOPS - 1):
        hops = hops + hops @ graph.astype(bool)
    used = np.zeros(mesh.vertex_count, dtype=bool)
    used[mesh.face_vertex_indices] = True
    pairs = KDTree(mesh.points).query_pairs(nearer or apart, output_type="ndarray").astype(np.int64)
    pairs = pairs[used[pairs].all(axis=1)]
    if not len(pairs):
        return False
    pairs = pairs[~np.asarray(hops[pairs[:, 0], pairs[:, 1]]).ravel().astype(bool)]
    starts, rows = np.unique(pairs[:, 0], return_inverse=True)
    for begin in range(0, len(starts), ROWS):
        own = (rows >= begin) & (rows < begin + ROWS)
        ways = dijkstra(graph, indices=starts[begin : begin + ROWS], limit=DETOUR * apart)
        if np.isinf(ways[rows[own] - begin, pairs[own, 1]]).any():
            return True
    return False


STRETCH = 0.1
"""Stretch of a skin, by which its parts grow, where the inflation names none"""
SLENDER = 2.0 * np.pi
"""Slenderness from which on a balloon may bend into itself: a tube's, whose ends meet around a hole as wide as it"""


def resolve_self_contact(scene: Scene, shapes: Sequence[BalloonShape]) -> Scene:
    """Return the scene with `touch.itself` settled by its meshes, where it is "auto".

    It is true where parts of any balloon are near each other, so that inflation may close the gap between them, and for
    foil, which folds anywhere: it bends freely and is flat or folded at the start. It is "soft" where any balloon is so
    slender that it may bend into itself, or starts pressed inward, by water or a vacuum: walls come together where the
    skin does not bear that. Either should cost next to nothing until then. Where contact cannot be simulated, as with a
    solver that takes over later, `touch` is false.
    """
    if not scene.meshes_settle_itself:
        return scene.model_copy(update={"touch": False}) if scene.touch is None else scene
    itself: bool | Literal["soft"] = _any_is_foil(scene.balloon, shapes) or _any_nears_itself(scene.balloon, shapes)
    itself = itself or ((_any_is_slender(shapes) or _any_is_pressed(scene, shapes)) and "soft")
    if scene.touch:
        return scene.model_copy(update={"touch": scene.touch.model_copy(update={"itself": itself})})
    # spheres touch faces as they do without this table
    return scene.model_copy(update={"touch": Touch(itself=itself, spheres=scene.faces_may_meet)}) if itself else scene


def _any_nears_itself(balloons: Sequence[Balloon], shapes: Sequence[BalloonShape]) -> bool:
    """Return whether any balloon nears itself; of balloons that are alike one is looked at."""
    stretches = [_stretch_of(balloon) for balloon in balloons]
    different = {(*_form(shape.mesh), stretch): shape.mesh for shape, stretch in zip(shapes, stretches, strict=True)}
    return any(nears_itself(mesh, stretch) for (*_, stretch), mesh in different.items())


def _any_is_slender(shapes: Sequence[BalloonShape]) -> bool:
    """Return whether any closed balloon is so slender that it may bend into itself; ribbons, such as hair, are not."""
    closed = {_form(shape.mesh): shape.mesh for shape in shapes if shape.closed}
    return any(slenderness(mesh) >= SLENDER for mesh in closed.values())


def _any_is_pressed(scene: Scene, shapes: Sequence[BalloonShape]) -> bool:
    """Return whether any balloon is pressed inward as it starts."""
    return any(starts_pressed(balloon, shape, scene) for balloon, shape in zip(scene.balloon, shapes, strict=True))


def _any_is_foil(balloons: Sequence[Balloon], shapes: Sequence[BalloonShape]) -> bool:
    """Return whether any balloon bends freely and has layers on each other, as foil has."""
    limp = {_form(shape.mesh): shape.mesh for each, shape in zip(balloons, shapes, strict=True) if bends_freely(each)}
    return any(is_in_layers(mesh) for mesh in limp.values())


def _stretch_of(balloon: Balloon) -> float:
    """Return the stretch that a balloon's inflation names."""
    return balloon.inflation.stretch if balloon.inflation.is_automatic else STRETCH


def _form(mesh: PolygonMesh) -> tuple[bytes, bytes]:
    """Return a key that is alike for meshes that differ in size and place alone."""
    points = mesh.points - mesh.points.min(axis=0)
    return mesh.face_vertex_indices.tobytes(), np.round(points / max(float(points.max()), 1e-30), 5).tobytes()


MOST_TRIANGLES = 100_000
"""Largest number of triangles that are looked at, so that a look takes seconds at most"""
ROUNDING = 1e-6
"""Depth that is none, over the size of the balloons"""


def crossed_starts(scene: Scene, shapes: Sequence[BalloonShape], parameters: Parameters) -> list[str]:
    """Return a sentence for each balloon that crosses itself at the start of the first world, and touches itself.

    And one for each two that cross and touch, of which one is open. Closed ones that overlap are pushed apart.
    """
    if not scene.touches or sum(shape.mesh.face_count for shape in shapes) > MOST_TRIANGLES:
        return []
    first = {name: parameters[name][:1] for name in ("initial_turns", "initial_shifts")}
    starts = [start_of(scene, first, number, shape.mesh.points)[0] for number, shape in enumerate(shapes)]
    if scene.touches_itself:
        which: list[tuple[int, ...]] = [(number,) for number in range(len(shapes))]
    else:
        which = []
    which += _overlapping(shapes, starts)
    found = (_sentence(numbers, shapes, starts) for numbers in which)
    return [sentence for sentence in found if sentence]


def _overlapping(shapes: Sequence[BalloonShape], starts: Sequence[NDArray[np.float64]]) -> Iterator[tuple[int, int]]:
    """Yield pairs of balloons, one of them open, whose boxes overlap."""
    lows, highs = (np.array([bound(points, axis=0) for points in starts]) for bound in (np.min, np.max))
    for number, shape in enumerate(shapes):
        for other in range(number):
            apart = (lows[number] > highs[other]) | (lows[other] > highs[number])
            if not apart.any() and not (shape.closed and shapes[other].closed):
                yield other, number


def _sentence(
    numbers: tuple[int, ...], shapes: Sequence[BalloonShape], starts: Sequence[NDArray[np.float64]]
) -> str | None:
    """Describe the crossing of one balloon with itself, or of two; None if nothing crosses."""
    triangles = [triangles_of(shapes[number].mesh) for number in numbers]
    counts = [len(starts[number]) for number in numbers]
    points = np.concatenate([starts[number] for number in numbers])
    found = find_crossings(points, np.concatenate([triangles[0], *(each + counts[0] for each in triangles[1:])]))
    edges_of_first, faces_of_first = found.edges[:, 0] < counts[0], found.triangles < len(triangles[0])
    deep = found.depths > ROUNDING * np.ptp(points, axis=0).max()
    those = np.flatnonzero(deep & ((edges_of_first != faces_of_first) | (len(numbers) == 1)))
    if not len(those):
        return None
    worst = those[found.depths[those].argmax()]
    names = [shapes[number].name for number in numbers]
    who = f"parts of {names[0]} cross each other" if len(names) == 1 else f"{names[0]} and {names[1]} cross"
    faces = len(np.unique(found.triangles[those]))
    place = ", ".join(f"{x:.3g}" for x in found.places[worst])
    passes = "touch.itself = false lets them pass" if len(names) == 1 else "touch.balloons = false lets them pass"
    return (
        f"touch: {who} at the start ({faces:,} face{'s' if faces > 1 else ''}, up to {found.depths[worst]:.2g} m near "
        f"({place})), and stay interlocked there: separate them by touch.thickness, or {passes} through"
    )


SHARP = 0.5
"""Cosine of the initial angle between the normals of an edge's two faces below which it is sharp: 60 degrees"""


def sharp_edges(mesh: PolygonMesh) -> NDArray[np.int64]:
    """Return the ends of a mesh's sharp edges, shape (E, 2).

    They are in the order and direction in which faces first traverse them, independent of vertex numbers.
    """
    edges = mesh_edges(mesh)
    areas = face_vector_areas(mesh)
    normals = areas / np.maximum(np.linalg.norm(areas, axis=1, keepdims=True), 1e-300)
    normals = normals[corner_faces(mesh)[edges.corners]] * np.where(edges.forward, 1.0, -1.0)[:, None]
    other = np.minimum(edges.starts + 1, len(edges.corners) - 1)
    cosine = -(normals[edges.starts] * normals[other]).sum(axis=1)  # the faces of an edge run along it both ways
    firsts = np.sort(edges.corners[edges.starts[(edges.face_counts != 2) | (cosine < SHARP)]])
    following = next_corners(mesh)[firsts]
    return mesh.face_vertex_indices[np.stack([firsts, following], axis=1)].astype(np.int64)


def edges_meet(scene: Scene, shapes: Sequence[BalloonShape]) -> bool:
    """Return whether edges of balloons may touch others."""
    if not scene.touches:
        return False
    have = [len(edges) > 0 for edges in meeting_edges(scene, shapes)]
    return any(have) if scene.touches_itself else sum(have) > 1


def meeting_edges(scene: Scene, shapes: Sequence[BalloonShape]) -> list[NDArray[np.int64]]:
    """Return the ends of the edges of each balloon that touch edges, each of shape (E, 2)."""
    said = scene.touch.edges if scene.touch else "auto"
    if said is False:
        return [np.zeros((0, 2), dtype=np.int64) for _ in shapes]
    takes_all = said is True or scene.touches_itself
    every = [takes_all or _may_fold(each, shape) for each, shape in zip(scene.balloon, shapes, strict=True)]
    return [_all_edges(shape) if own else sharp_edges(shape.mesh) for shape, own in zip(shapes, every, strict=True)]


def edges_by_leaf(
    triangles: NDArray[np.int64], leaves: NDArray[np.int64], edges: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return edges in the order of the triangles that have them first, and the leaf of each, shape (E, 2) and (E,).

    Args:
        leaves: that of each triangle, ascending.
    """
    count = int(triangles.max(initial=0)) + 1
    sides = np.sort(np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=-1), axis=-1).reshape(-1, 2) @ [count, 1]
    keys, firsts = np.unique(sides, return_index=True)
    own = firsts[np.searchsorted(keys, np.sort(edges, axis=1) @ [count, 1])]
    order = np.argsort(own, kind="stable")
    return edges[order], leaves[own[order] // 3]


def _may_fold(balloon: Balloon, shape: BalloonShape) -> bool:
    """Return whether a balloon may fold anywhere: it bends freely, and is folded, flat or open at the start."""
    return bends_freely(balloon) and (not shape.closed or is_folded(shape.mesh))


def _all_edges(shape: BalloonShape) -> NDArray[np.int64]:
    """Return all edges of a mesh, as contact cuts its faces into triangles."""
    triangles = triangles_of(shape.mesh)
    sides = np.sort(np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=-1).reshape(-1, 2), axis=1)
    return np.unique(sides[sides[:, 0] != sides[:, 1]], axis=0)


FLAT = 0.2
"""Turn of a surface within an edge of a balloon [rad], up to which faces follow it within the thickness of a skin"""
THIN = 5.0
"""Width of a solid, in mean edges of a balloon, below which it also touches faces"""
LEVEL = 0.6
"""Slope of the most level side of a box [rad], from which on the box stands on an edge or a corner"""
KEPT = 0.5
"""Distance that faces keep from ridges, over the thickness of a skin"""
BOX_SIGNS = np.array([(x, y, z) for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
"""Signs of the corners of a box"""


class Ridges(NamedTuple):
    """Ridges of a solid, as seen from that."""

    ends: NDArray[np.float64]
    """Begin and end of each ridge [m], shape (n, 2, 3)"""
    inward: NDArray[np.float64]
    """Unit vectors from each ridge along the two sides beside it, or zero where there is none, shape (n, 2, 3)"""
    radius: float
    """Radius around each ridge [m]"""
    tips: NDArray[np.int32]
    """Owned ends of a ridge, 1 for its begin plus 2 for its end, shape (n,): each corner is one ridge's"""


NO_RIDGES = Ridges(np.zeros((0, 2, 3)), np.zeros((0, 2, 3)), 0.0, np.zeros(0, np.int32))
"""Ridges of a solid that has none, such as a plane"""


def faces_meet(
    scene: Scene, shapes: Sequence[BalloonShape], obstacles: Sequence[ObstacleShape], bodies: Sequence[BodyShape]
) -> bool:
    """Return whether faces of balloons touch ridges: the scene says so, or something is thin beside them, or tilted."""
    solids = solids_of(obstacles, bodies)
    if scene.faces is True or not scene.faces_may_meet:
        return scene.faces_may_meet and any(solid.kind != "plane" for solid in solids)
    widest = max(edge_length(shape.mesh) for shape in shapes)
    return any(is_thin(solid, THIN * widest) for solid in solids) or _any_on_edge(scene, obstacles)


def _any_on_edge(scene: Scene, obstacles: Sequence[ObstacleShape]) -> bool:
    """Return whether a box stands on an edge or a corner at the start: a balloon that falls on it meets such first."""
    boxes = [number for number, solid in enumerate(obstacles) if solid.kind == "box"]
    if not boxes:
        return False
    from scipy.spatial.transform import Rotation  # takes long to load

    turns = Rotation.from_quat(obstacle_motion(scene)[0][boxes, 3:])
    return bool((np.abs(turns.inv().apply(np.array(scene.up))).max(axis=1) < np.cos(LEVEL)).any())


def solids_of(obstacles: Sequence[ObstacleShape], bodies: Sequence[BodyShape]) -> list[ObstacleShape]:
    """Return obstacles, and after them bodies about their centers of mass."""
    return [*obstacles, *(body.solid for body in bodies)]


def ridges_of(solid: ObstacleShape, up: NDArray[np.float64], edge: float) -> Ridges:
    """Find the ridges of a solid; a plane has none.

    Args:
        edge: mean one of the balloons [m]: a surface that turns less within that is round to them, and no ridge.
    """
    if solid.kind == "box":
        ridges = _ridges_of_box(solid.size)
    elif solid.kind == "capsule":
        ends = np.stack([-solid.size[1] * up, solid.size[1] * up])[None]
        ridges = Ridges(ends, np.zeros((1, 2, 3)), float(solid.size[0]), np.array([3], np.int32))
    elif solid.mesh is not None:
        ridges = _ridges_of_mesh(solid.mesh, solid.triangles, solid.closed, edge)
    else:
        ridges = NO_RIDGES
    return ridges._replace(radius=ridges.radius + solid.thickness)


def _ridges_of_box(half: NDArray[np.float64]) -> Ridges:
    ends, inward = [], []
    for axis in range(3):
        for corner in BOX_SIGNS[BOX_SIGNS[:, axis] < 0.0]:
            along = np.eye(3)[axis]
            ends.append([corner * half, (corner + 2.0 * along) * half])
            inward.append([-corner[other] * np.eye(3)[other] for other in range(3) if other != axis])
    return with_tips(np.array(ends), np.array(inward), 0.0)


def _ridges_of_mesh(mesh: PolygonMesh, triangles: NDArray[np.int32], closed: bool, edge: float) -> Ridges:
    """Return rims of sheets, and edges between triangles that are not flat; of closed meshes, the convex ones."""
    points = mesh.points
    surface = PolygonMesh(points, np.full(len(triangles), 3, np.int32), triangles.ravel())
    areas = face_vector_areas(surface)
    normals = areas / np.maximum(np.linalg.norm(areas, axis=1, keepdims=True), 1e-300)
    begin = triangles.ravel()
    end = np.roll(triangles, -1, axis=1).ravel()
    apex = np.roll(triangles, -2, axis=1).ravel()
    faces = np.repeat(np.arange(len(triangles)), 3)
    keys, numbers = np.unique(np.sort(np.stack([begin, end], axis=1), axis=1), axis=0, return_inverse=True)
    order = np.argsort(numbers.ravel(), kind="stable")
    starts = np.searchsorted(numbers.ravel()[order], np.arange(len(keys) + 1))
    ends, inward = [], []
    for number, (first, last) in enumerate(pairwise(starts)):
        sides = order[first:last]
        a, b = points[keys[number]]
        if np.array_equal(a, b):
            continue
        across = [_across(a, b, points[apex[side]]) for side in sides[:2]]
        lengths = [float(np.linalg.norm(way)) for way in across]
        within = [way / max(length, 1e-300) for way, length in zip(across, lengths, strict=True)]
        if len(sides) == 2:
            rise = float(normals[faces[sides[0]]] @ within[1])
            turn = np.arctan2(abs(rise), normals[faces[sides[0]]] @ normals[faces[sides[1]]])
            # the surface turns once on the way through half of both triangles
            if turn * max(1.0, 2.0 * edge / max(sum(lengths), 1e-300)) <= FLAT or (closed and rise > 0.0):
                continue
        known = within if len(sides) <= 2 else [np.zeros(3)]
        ends.append([a, b])
        inward.append([*known, np.zeros(3)][:2])
    return with_tips(np.array(ends).reshape(-1, 2, 3), np.array(inward).reshape(-1, 2, 3), 0.0)


def _across(a: NDArray[np.float64], b: NDArray[np.float64], apex: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the vector from an edge, across it, to a triangle's third corner."""
    along = (b - a) / np.linalg.norm(b - a)
    return apex - a - ((apex - a) @ along) * along


def with_tips(ends: NDArray[np.float64], inward: NDArray[np.float64], radius: float) -> Ridges:
    """Assign each corner to the first ridge that ends there."""
    _, firsts = np.unique(ends.reshape(-1, 3), axis=0, return_index=True)
    own = np.zeros(2 * len(ends), np.int32)
    own[firsts] = 1
    tips = own[0::2] + 2 * own[1::2]
    return Ridges(ends, inward, radius, tips.astype(np.int32))


def all_ridges(
    scene: Scene, shapes: Sequence[BalloonShape], obstacles: Sequence[ObstacleShape], bodies: Sequence[BodyShape]
) -> list[Ridges]:
    """Find the ridges of obstacles, then of bodies, that faces of balloons meet; none where faces meet none."""
    if not faces_meet(scene, shapes, obstacles, bodies):
        return []
    edge = max(edge_length(shape.mesh) for shape in shapes)
    return [ridges_of(solid, np.array(scene.up), edge) for solid in solids_of(obstacles, bodies)]


def kept_distance(shapes: Sequence[BalloonShape]) -> float:
    """Return how far faces of balloons are kept from ridges [m]."""
    return KEPT * THICKNESS * min(edge_length(shape.mesh) for shape in shapes)


def ridge_tree(ridges: Ridges, device: wp.Device) -> wp.Bvh | None:
    """Make a tree of boxes around ridges; none of none."""
    if not len(ridges.ends):
        return None
    lower, upper = ridges.ends.min(axis=1) - ridges.radius, ridges.ends.max(axis=1) + ridges.radius
    return wp.Bvh(wp.array(lower, dtype=wp.vec3, device=device), wp.array(upper, dtype=wp.vec3, device=device))
