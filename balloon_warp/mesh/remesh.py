"""Remeshing of any surface as a closed mesh of even quads: signed distance, then surface nets."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from balloon_warp.arguments import checked
from balloon_warp.errors import InputError
from balloon_warp.mesh.components import component_labels
from balloon_warp.mesh.crossings import crossings_said
from balloon_warp.mesh.feasible import (
    MOST_BY_ITSELF,
    MOST_QUADS,
    quads_expected,
    require_no_ribbons,
    require_quads,
    wrong_volume,
)
from balloon_warp.mesh.fidelity import infidelity
from balloon_warp.mesh.fit import fitted, slabs_left
from balloon_warp.mesh.fusion import fusions_said
from balloon_warp.mesh.handles import handle_count, handles_lost, handles_of_level, handles_said
from balloon_warp.mesh.level import Level
from balloon_warp.mesh.look_transfer import dressed
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.surface_nets import surface_nets
from balloon_warp.mesh.topology import mesh_edges
from balloon_warp.mesh.uncrossed import without_crossings
from balloon_warp.warp_logging import quiet_warp

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
    fused = fusions_said(mesh, made.quads, Level.width(mesh, made.cells))
    on_stage("transferring colors and textures")
    return dressed(replace(made.quads, warnings=(*mesh.warnings, *more, *made.warnings, *fused)), mesh)


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
        crossed = None if wrong else crossings_said(self.quads)
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
    what, needed = handles_said(lost, handle_count(mesh)), _cells_for_handles(mesh, made.cells)
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
