"""Remeshing of any surface as a closed mesh of even quads, with tests that it can be and that nothing is lost."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from balloon_warp.errors import InputError
from balloon_warp.mesh.crossings import crossings_sentence, without_crossings
from balloon_warp.mesh.load import welded_along_seams, with_looks_of
from balloon_warp.mesh.orientation import facing_outward, oriented_outward
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.repair import distinct_faces
from balloon_warp.mesh.surface_nets import Level, MeshDistance, extract, fitted, grid_nodes, slabs_left, surface_nets
from balloon_warp.mesh.thickness import RIBBONS
from balloon_warp.mesh.topology import (
    border_edges,
    component_count,
    component_labels,
    face_areas,
    face_centers,
    face_starts,
    face_volumes,
    first_coincident,
    genus,
    inconsistent_edges,
    mesh_edges,
    signed_volume,
    total_area,
    triangulate,
    vertex_components,
)
from balloon_warp.system.api import checked
from balloon_warp.system.warp_setup import quiet_warp

MOST_QUADS = 400_000
"""Largest number of quads of a result"""
MOST_BY_ITSELF = 60_000
"""Largest number of quads of a result with more cells than were asked for"""
DENSITY = 1.35
"""Number of quads in a square cell of the surface"""
PLACES = 100
"""Number of samples on a surface"""
MOSTLY = 0.5
"""Fraction of the surface that counts as most of it"""
OFF = 0.1
"""Relative tolerance of the volume"""


def quads_expected(mesh: PolygonMesh, cells: int) -> float:
    """Return the approximate number of quads of a surface, which has two sides where it is open."""
    used = mesh.points[mesh.face_vertex_indices]
    cell = float(np.ptp(used, axis=0).max()) / cells
    return DENSITY * total_area(mesh) / cell**2


def require_quads(mesh: PolygonMesh, cells: int) -> None:
    """Make sure that so many cells give no more quads than one can use.

    Raises:
        InputError: they do; it names how many cells give as many.
    """
    expected = quads_expected(mesh, cells)
    if expected > MOST_QUADS:
        most = int(cells * (MOST_QUADS / expected) ** 0.5)
        raise InputError(
            f"{mesh.name}: {cells} cells would make {expected:,.0f} quads; expected --cells {max(most, 4)} or fewer"
        )


def require_no_ribbons(mesh: PolygonMesh) -> None:
    """Make sure that a surface does not consist of ribbons, as hair does.

    Patches of a whole are many open parts, too, but wind around something.

    Raises:
        InputError: it does; the message names an input that can be taken.
    """
    whole = oriented_outward(welded_along_seams(mesh))
    edges = mesh_edges(whole)
    component = vertex_components(whole, edges)
    of_faces = component[whole.face_vertex_indices[face_starts(whole)]]
    open_parts = np.unique(component[edges.ends[border_edges(edges), 0]])
    areas = face_areas(whole) * np.isin(of_faces, open_parts)
    if len(open_parts) < RIBBONS or areas.sum() < MOSTLY * total_area(whole) or _winds_around(whole, areas) >= MOSTLY:
        return
    parts = len(np.unique(of_faces))
    helps = "--parts closed" if parts > len(open_parts) else "a surface with an inside, or a few sheets"
    raise InputError(
        f"{mesh.name}: {len(open_parts):,} of its {parts:,} parts are open, like hair, and enclose nothing; expected "
        f"{helps}"
    )


def _winds_around(mesh: PolygonMesh, areas: NDArray[np.float64]) -> float:
    """Return the fraction of sample points behind which the rest of the surface winds around something.

    There the winding number is a half on the surface itself, and it is 0 on a sheet (Van Oosterom and Strackee 1983).

    Args:
        areas: by which places are chosen, shape (face_count,).
    """
    triangles, of_faces = triangulate(mesh)
    corners = mesh.points[triangles]
    faces = np.unique(np.searchsorted(np.cumsum(areas), (np.arange(PLACES) + 0.5) / PLACES * areas.sum()))
    windings = []
    for face, center in zip(faces.tolist(), face_centers(mesh)[faces], strict=True):
        a, b, c = np.moveaxis(corners[of_faces != face] - center, 1, 0)
        la, lb, lc = (np.linalg.norm(each, axis=1) for each in (a, b, c))
        volume = (a * np.cross(b, c)).sum(axis=1)
        flat = la * lb * lc + (a * b).sum(axis=1) * lc + (b * c).sum(axis=1) * la + (c * a).sum(axis=1) * lb
        windings.append(np.arctan2(volume, flat).sum() / (2.0 * np.pi))
    return float((np.abs(np.array(windings) - 0.5) < 0.25).mean())


def wrong_volume(mesh: PolygonMesh, quads: PolygonMesh) -> str | None:
    """Return the defect in the volume of a remeshed closed surface, as the end of a sentence.

    None where there is none, or the surface is open. Parts that overlap have less than their sum, but no less than the
    largest.
    """
    whole = facing_outward(welded_along_seams(mesh))
    edges = mesh_edges(whole)
    if len(border_edges(edges)) or len(inconsistent_edges(edges)):
        return None
    component = vertex_components(whole, edges)[whole.face_vertex_indices[face_starts(whole)]]
    volumes = np.bincount(component, face_volumes(whole), whole.vertex_count)
    made = signed_volume(quads)
    if (1.0 - OFF) * volumes.max() <= made <= (1.0 + OFF) * volumes.sum():
        return None
    return f"its volume changes from {volumes.sum():.3g} to {made:.3g}"


NEAR = 2.0
"""Largest distance of a vertex of the result from the surface [cells]: half an edge, half a slab and rounding"""
SPECK = 1.5
"""Size below which a part may be left out [cells]"""


def infidelity(surface: PolygonMesh, result: PolygonMesh, cell: float) -> str | None:
    """Return the infidelity of a closed mesh to its source surface, as the end of a sentence; None if there is none.

    Args:
        surface: Source surface; parts that overlap or come close may have become one.
        result: Mesh whose vertices all belong to faces.
        cell: Width of a grid cell.
    """
    edges = mesh_edges(distinct_faces(result)[0])
    flaws = len(border_edges(edges)) + len(inconsistent_edges(edges))
    if flaws:
        return f"{flaws:,} of its edges {'is' if flaws == 1 else 'are'} open or crossed"
    points, parts = samples_of_parts(surface)
    labels = vertex_components(result, edges)
    made = len(np.unique(labels))
    lowest = np.full((int(parts.max()) + 1, 3), np.inf)
    highest = -lowest
    np.minimum.at(lowest, parts, points)
    np.maximum.at(highest, parts, points)
    sizes = np.linalg.norm(highest - lowest, axis=1)
    counts = sizes[parts] > SPECK * cell
    points, parts = points[counts], parts[counts]
    away, which = map(np.asarray, KDTree(result.points).query(points))
    far = away > NEAR * cell
    if place := _lost(points[far], result, cell):
        return f"the surface near {place} is lost"
    if place := _piece(points[~far], parts[~far], result, labels[which[~far]], labels, NEAR * cell):
        return f"one part breaks into pieces near {place}"
    return f"it has {made:,} parts instead of {len(sizes):,}" if made > len(sizes) else None


def samples_of_parts(surface: PolygonMesh) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the vertices of faces and the faces' centers, shape (n, 3), with the part of each, shape (n,).

    Vertices at one place are one. Parts share no edge: an eye that touches its socket in a vertex is one.
    """
    corners = first_coincident(surface.points)[surface.face_vertex_indices].astype(np.int64)
    ends = np.cumsum(surface.face_vertex_counts)
    of_faces = np.repeat(np.arange(surface.face_count), surface.face_vertex_counts)
    following = np.arange(1, len(corners) + 1)
    following[ends - 1] = ends - surface.face_vertex_counts
    low, high = np.minimum(corners, corners[following]), np.maximum(corners, corners[following])
    _, edges = np.unique(low * len(surface.points) + high, return_inverse=True)
    count = surface.face_count
    labels = component_labels(count + int(edges.max()) + 1, of_faces, count + edges)[:count]
    _, parts = np.unique(labels, return_inverse=True)
    used = np.unique(np.stack([corners, parts[of_faces]], axis=1), axis=0)
    return np.concatenate([surface.points[used[:, 0]], face_centers(surface)]), np.concatenate([used[:, 1], parts])


def _lost(points: NDArray[np.float64], result: PolygonMesh, cell: float) -> str | None:
    """Return the first of some places outside of the result; places within it, as where parts overlap, are fine."""
    if not len(points):
        return None
    middle = result.points.mean(axis=0)
    distance = MeshDistance((result.points - middle) / cell, triangulate(result)[0], thickness=0.0)
    out = points[distance((points - middle) / cell) > 0.0]
    return place_text(out[0]) if len(out) else None


def _piece(
    points: NDArray[np.float64],
    parts: NDArray[np.int64],
    result: PolygonMesh,
    nearest: NDArray[np.int64],
    labels: NDArray[np.int64],
    near: float,
) -> str | None:
    """Return where a part is missing from its component of the result, unless a component is near all of it.

    Args:
        points: Places, shape (n, 3).
        parts: Part of each, shape (n,).
        nearest: Component that is nearest to each, shape (n,).
        labels: Component of each vertex of the result.
        near: Distance that counts as near.
    """
    trees = {component: KDTree(result.points[labels == component]) for component in np.unique(nearest)}
    order = np.argsort(parts, kind="stable")
    for part in np.split(order, np.flatnonzero(np.diff(parts[order])) + 1):
        own, components = points[part], np.unique(nearest[part])
        missed = [own[np.asarray(trees[component].query(own)[0]) > near] for component in components]
        if missed and all(map(len, missed)):
            return place_text(min(missed, key=len)[0])
    return None


def place_text(point: NDArray[np.float64]) -> str:
    """Return a place as text."""
    return f"({', '.join(f'{coordinate:.3g}' for coordinate in point)})"


NAMED = 6
"""Number of parts that a sentence names at most"""


def fusions_sentence(surface: PolygonMesh, result: PolygonMesh, cell: float) -> list[str]:
    """Return a sentence for each component of the result that several parts have become, and one of those within it.

    A part is a group's name, where it is all of that group, or its size and middle in the file's unit. Specks are left
    out.

    Args:
        surface: Source surface.
        result: Mesh that stands for it, whose vertices all belong to faces.
        cell: Width of a grid cell.
    """
    points, parts = samples_of_parts(surface)
    count = int(parts.max()) + 1
    if count == 1:
        return []
    labels = vertex_components(result, mesh_edges(result))
    away, which = map(np.asarray, KDTree(result.points).query(points))
    near = away <= NEAR * cell
    became: dict[int, list[int]] = {}
    inside = []
    for part in range(count):
        own = parts == part
        if np.linalg.norm(np.ptp(points[own], axis=0)) <= SPECK * cell:
            continue
        if not (own & near).any():
            inside.append(part)
            continue
        components, votes = np.unique(labels[which[own & near]], return_counts=True)
        became.setdefault(int(components[votes.argmax()]), []).append(part)
    said = [
        f"{_named(surface, points, parts, fused)} became one part: they overlap, or come within {NEAR:g} cells."
        for fused in became.values()
        if len(fused) > 1
    ]
    if inside:
        lies = "lies" if len(inside) == 1 else "lie"
        said.append(f"{_named(surface, points, parts, inside)} {lies} inside of others and left no quads.")
    return said


def _named(surface: PolygonMesh, points: NDArray[np.float64], parts: NDArray[np.int64], which: Sequence[int]) -> str:
    """Name parts, the largest first."""
    sizes = [float(np.linalg.norm(np.ptp(points[parts == part], axis=0))) for part in which]
    order = [which[number] for number in np.argsort(sizes, kind="stable")[::-1]]
    names = [_name(surface, points[parts == part]) for part in order[:NAMED]]
    if len(order) > NAMED:
        names.append(f"{len(order) - NAMED:,} smaller ones")
    text = " and ".join(filter(None, [", ".join(names[:-1]), names[-1]]))
    return text[0].upper() + text[1:] if text.startswith("a part") else text


def _name(surface: PolygonMesh, own: NDArray[np.float64]) -> str:
    """Name a part by its group, or else by its size and middle."""
    low, high = own.min(axis=0), own.max(axis=0)
    for name, vertices in surface.groups.items():
        group = surface.points[vertices]
        if np.array_equal(group.min(axis=0), low) and np.array_equal(group.max(axis=0), high):
            return name
    return f"a part of {np.ptp(own, axis=0).max():.3g} at {place_text((low + high) / 2.0)}"


AHEAD = 0.01
"""Free distance in front of a clean surface, over a triangle's size, and at least `LEAST_AHEAD` cells"""
LEAST_AHEAD = 1e-3
CROSSING = 1e-3
"""Least fraction of the surface inside the rest of it where parts cross"""
COARSEST = 8
"""Node spacing of the grid that is searched first [cells]"""


def handles_lost(surface: PolygonMesh, result: PolygonMesh) -> int | None:
    """Return how many handles fewer a closed mesh has than its source surface, negative if it has more.

    None where the number is meaningless: a surface that is open or crosses itself has none, and parts that merged or
    vanished took theirs along.
    """
    parts, handles = _counted(result)
    parts_before, handles_before = _counted(facing_outward(welded_along_seams(surface)))
    if handles is None or handles_before is None or parts != parts_before:
        return None
    lost = handles_before - handles
    return lost if not lost or not _crosses_itself(surface) else None


def handle_count(surface: PolygonMesh) -> int:
    """Return the handles of a closed surface."""
    return _counted(facing_outward(welded_along_seams(surface)))[1] or 0


def handles_sentence(lost: int, handles: int) -> str:
    """Return the change of the number of handles, as the end of a sentence."""
    if lost > 0:
        return f"{lost:,} of its {handles:,} handles, or holes through it, {'is' if lost == 1 else 'are'} lost"
    return f"it gains {-lost:,} {'handle' if lost == -1 else 'handles'} over its {handles:,}"


def handles_of_level(distance: MeshDistance, reach: NDArray[np.float64]) -> int | None:
    """Return the handles of the zero level of a distance, as surface nets have it with cells of 1.

    Args:
        distance: of a closed surface: nowhere does it change by more than the way.
        reach: half of the box around the middle that the surface is in, shape (3,).
    """
    blocks = np.ceil(2.0 * reach / COARSEST).astype(int) + 1
    lower = -0.5 * COARSEST * blocks - 0.5  # the nodes of `surface_nets`, whose middle is that of a cell
    values, step = distance(grid_nodes(lower, float(COARSEST), blocks)).reshape(blocks + 1), COARSEST
    while step > 1:
        step //= 2
        values = _finer(values, distance, lower, step)
    return _counted(extract(values, lower, 1.0))[1]


def _finer(
    values: NDArray[np.float64], distance: Callable, lower: NDArray[np.float64], step: int
) -> NDArray[np.float64]:
    """Return the distance at nodes that are half as far from each other; far from the surface the least that it can be.

    Args:
        values: at the nodes before, shape (nx, ny, nz).
        step: between the new ones.
    """
    cells = 2 * (np.array(values.shape) - 1)
    for axis in range(3):
        values = np.take(values, np.arange(cells[axis] + 1) // 2, axis=axis)
    way = np.sqrt(3.0) * step
    near = np.abs(values) <= 1.01 * way
    values = values - np.sign(values) * way
    values[near] = distance(lower + step * np.argwhere(near))
    return values


def _counted(mesh: PolygonMesh) -> tuple[int, int | None]:
    """Return the numbers of parts and of handles.

    The latter is None where the mesh is open, crossed or mixed in winding.
    """
    edges = mesh_edges(mesh)
    handles = None if len(inconsistent_edges(edges)) else genus(mesh, edges)
    return component_count(mesh, edges), handles


def _crosses_itself(surface: PolygonMesh) -> bool:
    """Return whether parts of a closed surface are within other parts of it."""
    used = surface.points[surface.face_vertex_indices]
    size = np.ptp(used, axis=0).max()
    points = (surface.points - used.mean(axis=0)) * (256.0 / size)  # Warp measures in float32
    triangles, _ = triangulate(facing_outward(welded_along_seams(surface)))
    a, b, c = np.moveaxis(points[triangles], 1, 0)
    normals = np.cross(b - a, c - a)
    doubled = np.linalg.norm(normals, axis=1)
    some = doubled > 0.0
    ahead = np.maximum(AHEAD * np.sqrt(doubled[some]), LEAST_AHEAD) / doubled[some]
    before = (a + b + c)[some] / 3.0 + ahead[:, None] * normals[some]
    within = MeshDistance(points, triangles, thickness=0.0)(before) < 0.0
    return bool(doubled[some][within].sum() > CROSSING * doubled.sum())


MIN_CELLS, MAX_CELLS = 4, 256
TRIES, FINER = 3, 1.5
"""Number of attempts, and the factor on the number of cells, where the result is not faithful"""
CRUMB = 3.0
"""Box size up to which a part is a crumb [cells], from a speck of a cell and a half"""


@checked
def remesh(mesh: PolygonMesh, cells: int, on_stage: Callable[[str], None] = lambda stage: None) -> PolygonMesh:
    """Make a closed quad mesh of a surface that may have holes, cracks, flipped faces and sheets without thickness.

    The space that the surface winds around becomes the inside. Holes are closed by a smooth membrane. Sheets become 1.5
    cells thick, but parts with an inside stay as thin as they are, and tips where they are. Crumbs are dropped. Every
    other part of the surface is there in one piece, and a clean surface keeps its handles, which may take more cells.
    Colors and textures are those of the nearest place on the surface. `warnings` lists the changes. It runs on Warp's
    default device.

    Args:
        mesh: Surface; the result keeps its name, unit and up axis.
        cells: Grid cells along the longest side of its bounding box, from 4 to 256. Edges are about a cell long.
        on_stage: Called with a few words at each stage; a mesh of 200,000 faces takes a minute.

    Raises:
        InputError: `cells` is out of range, the mesh has no size, it is of many ribbons, there would be too many quads,
            or more cells do not help either.
    """
    if not MIN_CELLS <= cells <= MAX_CELLS:
        raise InputError(f"cells must be from {MIN_CELLS} to {MAX_CELLS} (got {cells})")
    quiet_warp()
    if Level.width(mesh, cells) == 0.0:
        raise InputError(f"{mesh.name}: all vertices coincide; expected a surface")
    on_stage("analyzing the surface")
    require_quads(mesh, cells)
    require_no_ribbons(mesh)
    made = _keeping_handles(mesh, _faithful(mesh, cells, on_stage), on_stage)
    more = [f"With {cells} cells {made.wrong}: {made.cells} were used."] if made.cells > cells else []
    fused = fusions_sentence(mesh, made.quads, Level.width(mesh, made.cells))
    on_stage("transferring colors and textures")
    return with_looks_of(replace(made.quads, warnings=(*mesh.warnings, *more, *made.warnings, *fused)), mesh)


@dataclass(frozen=True)
class _Made:
    """Quads of a surface."""

    quads: PolygonMesh
    cells: int
    warnings: list[str]
    wrong: str | None = None
    """Defect with fewer cells, as the end of a sentence"""

    def mistake(self, mesh: PolygonMesh) -> str | None:
        """Return the part of the surface that the quads do not represent, as the end of a sentence."""
        wrong = infidelity(mesh, self.quads, Level.width(mesh, self.cells)) or wrong_volume(mesh, self.quads)
        crossed = None if wrong else crossings_sentence(self.quads)
        return f"it {crossed}" if crossed else wrong


def _faithful(mesh: PolygonMesh, cells: int, on_stage: Callable[[str], None]) -> _Made:
    """Return the quads that stand for the surface, of so many cells, or of more where it takes more.

    Raises:
        InputError: more do not help.
    """
    finer = [min(round(cells * FINER**power), MAX_CELLS) for power in range(1, TRIES)]
    number, mistake, wrong = cells, None, None
    for number in dict.fromkeys([cells, *(more for more in finer if quads_expected(mesh, more) < MOST_BY_ITSELF)]):
        made = replace(_quads(mesh, number, on_stage), wrong=wrong)
        on_stage("comparing the quads with the surface")
        mistake = made.mistake(mesh)
        if mistake is None:
            return made
        wrong = wrong or mistake
    more = 2 * number
    finer_helps = more <= MAX_CELLS and quads_expected(mesh, more) < MOST_QUADS
    expected = f"--cells {more}, or a surface without that" if finer_helps else "a surface without that"
    raise InputError(f"{mesh.name}: with {number} cells {mistake}; expected {expected}")


def _keeping_handles(mesh: PolygonMesh, made: _Made, on_stage: Callable[[str], None]) -> _Made:
    """Return the quads that have the handles of the surface, of more cells where it takes more.

    Raises:
        InputError: it takes so many that one has to ask for them.
    """
    lost = handles_lost(mesh, made.quads)
    if not lost:
        return made
    on_stage("searching the number of cells that keeps the handles")
    what, needed = handles_sentence(lost, handle_count(mesh)), _cells_for_handles(mesh, made.cells)
    if needed and quads_expected(mesh, needed) < MOST_BY_ITSELF:
        finer = replace(_quads(mesh, needed, on_stage), wrong=made.wrong or what)
        if not finer.mistake(mesh) and not handles_lost(mesh, finer.quads):
            return finer
    if needed and lost > 0:
        raise InputError(
            f"{mesh.name}: with {made.cells} cells {what}; expected --cells {needed}, or a surface without that"
        )
    why = "no number of cells keeps the handles" if lost > 0 else "parts come too near each other"
    return replace(made, warnings=[*made.warnings, f"With {made.cells} cells {what}: {why}."])


def _cells_for_handles(mesh: PolygonMesh, cells: int) -> int | None:
    """Return a larger number of cells that keeps the handles of a surface; None where no feasible number does."""
    wanted = handle_count(mesh)
    while cells < MAX_CELLS:
        cells = min(round(cells * FINER), MAX_CELLS)
        if quads_expected(mesh, cells) > MOST_QUADS:
            return None
        level = Level.of(mesh, cells)
        if handles_of_level(level.distance, level.reach) == wanted:
            return cells
    return None


def _quads(mesh: PolygonMesh, cells: int, on_stage: Callable[[str], None]) -> _Made:
    """Make a closed quad mesh of a surface, with so many cells, and its warnings."""
    on_stage("finding thin parts")
    level = Level.of(mesh, cells)
    on_stage(f"building quads on a grid of {cells} cells")
    nets = surface_nets(level.distance, -level.reach, level.reach, cell=1.0)
    if nets.face_count == 0:
        raise InputError(
            f"{mesh.name}: no part is as thick as a cell ({level.cell:.3g}); expected more than {cells} cells"
        )
    kept, warnings = _without_crumbs(nets)
    on_stage("fitting the quads to the surface")
    used = mesh.points[np.unique(mesh.face_vertex_indices)]
    kept = without_crossings(kept, fitted(kept, level.distance, (used - level.middle) / level.cell))
    if level.distance.has_thin_parts and slabs_left(kept, level.distance):
        warnings.append(
            f"Open parts became 1.5 cells thick ({1.5 * level.cell:.3g}), as did thin parts without room; more cells "
            "make them thinner."
        )
    placed = replace(
        mesh,
        points=kept.points * level.cell + level.middle,
        face_vertex_counts=kept.face_vertex_counts,
        face_vertex_indices=kept.face_vertex_indices,
        texture_coordinates=None,
        looks=None,
        groups={},
        stand_ins=None,
    )
    return _Made(placed, cells, warnings)


def _without_crumbs(mesh: PolygonMesh) -> tuple[PolygonMesh, list[str]]:
    """Find the components of the mesh that are worth keeping, and warnings about the others; points are in cells."""
    edges = mesh_edges(mesh)
    labels = component_labels(mesh.vertex_count, edges.ends[:, 0], edges.ends[:, 1])
    lowest, highest = np.full((mesh.vertex_count, 3), np.inf), np.full((mesh.vertex_count, 3), -np.inf)
    np.minimum.at(lowest, labels, mesh.points)
    np.maximum.at(highest, labels, mesh.points)
    sizes = (highest - lowest).max(axis=1)  # minus infinity where no component has that number
    worth = sizes >= min(CRUMB, sizes.max())
    parts, crumbs = np.count_nonzero(worth), np.count_nonzero(~worth & (sizes >= 0.0))
    warnings = [f"The mesh has {parts} separate parts."] if parts > 1 else []
    if crumbs:
        what = "1 crumb" if crumbs == 1 else f"{crumbs} crumbs"
        warnings.append(f"Left out {what} smaller than {CRUMB:g} cells.")
    return _vertices_kept(mesh, worth[labels]), warnings


def _vertices_kept(mesh: PolygonMesh, keep: NDArray[np.bool_]) -> PolygonMesh:
    """Return the quad mesh without the components whose vertices are not kept."""
    quads = mesh.face_vertex_indices.reshape(-1, 4)
    quads = (np.cumsum(keep) - 1)[quads[keep[quads[:, 0]]]].astype(np.int32)
    return replace(
        mesh,
        points=mesh.points[keep],
        face_vertex_counts=np.full(len(quads), 4, dtype=np.int32),
        face_vertex_indices=quads.ravel(),
    )
