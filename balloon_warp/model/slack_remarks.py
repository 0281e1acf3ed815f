"""Sentences on faces that a pressure does not push, with remedies."""

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.feasible import RIBBONS
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.topology import (
    border_edges,
    component_labels,
    corner_faces,
    face_starts,
    mesh_edges,
    vertex_components,
)

NOTHING_HELD = (
    "Not inflated: the mesh is open and its border is not pinned, so it would fly away. {} "
    "--set balloon.inflation.pressure=100."
)
CLOSES = "Close it by `balloon-warp remesh`, pin the border by `fixed`, or give a pressure:"
HOLDS = "Pin the border by `fixed`, or give a pressure:"
NO_INSIDE = (
    "Not inflated: no face lies between an inside and an outside, as on a Moebius strip. `balloon-warp remesh` makes "
    "a closed surface of it; or give a pressure, such as --set balloon.inflation.pressure=100, which pushes each face "
    "along its normal."
)


def about_slack(mesh: PolygonMesh, slack: NDArray[np.bool_], moves: NDArray[np.bool_]) -> tuple[str, ...]:
    """Return sentences on open parts that are carried along, and on walls; or one on a balloon without inflation.

    Args:
        slack: Faces that a pressure does not push, shape (face_count,).
        moves: Vertices that nothing holds, shape (vertex_count,).
    """
    if not slack.any():
        return ()
    edges = mesh_edges(mesh)
    border = edges.ends[border_edges(edges)]
    components = vertex_components(mesh, edges)
    ribbons = len(np.unique(components[border[:, 0]])) >= RIBBONS
    if slack.all():
        return (NOTHING_HELD.format(HOLDS if ribbons else CLOSES) if moves[border].any() else NO_INSIDE,)
    # Connected slack faces, and whether they have a border.
    faces = corner_faces(mesh)[edges.corners]
    first = np.repeat(edges.starts, edges.face_counts)
    both = slack[faces] & slack[faces[first]]
    pieces = component_labels(mesh.face_count, faces[both], faces[first][both])
    has_border = np.zeros(mesh.face_count, dtype=bool)
    has_border[pieces[faces[edges.starts[border_edges(edges)]]]] = True
    open_, walls = slack & has_border[pieces], slack & ~has_border[pieces]
    component = components[mesh.face_vertex_indices[face_starts(mesh)]]
    apart = not np.isin(component[open_], component[~slack]).any()
    thick = "." if ribbons else "; `balloon-warp remesh` thickens it."
    more = f" --parts closed leaves it out{thick}" if apart else ""
    if 2 * np.count_nonzero(open_) > mesh.face_count and not more and not ribbons:
        more = " `balloon-warp remesh` makes a closed surface of the mesh."
    return (
        *_sentence(mesh, open_, "open, like a pane, and has no inside: it is carried along, not inflated.", more),
        *_sentence(mesh, walls, "a wall with equal pressure on both sides, which does not push it.", ""),
    )


def _sentence(mesh: PolygonMesh, faces: NDArray[np.bool_], what: str, more: str) -> tuple[str, ...]:
    count = np.count_nonzero(faces)
    if not count:
        return ()
    corners = mesh.face_vertex_indices[faces[corner_faces(mesh)]]
    name = _group_of(mesh, corners)
    where = f"{name}, at vertex {corners[0] + 1}" if name else f"at vertex {corners[0] + 1}"
    return (f"A part of {count:,} of its {mesh.face_count:,} faces ({where}, counting from 1) is {what}{more}",)


def _group_of(mesh: PolygonMesh, vertices: NDArray[np.integer]) -> str | None:
    """Return the smallest of the mesh's groups that has all of these vertices, if there is one."""
    own = np.unique(vertices)
    having = [(len(group), name) for name, group in mesh.groups.items() if np.isin(own, group).all()]
    return min(having)[1] if having and min(having)[0] < mesh.vertex_count else None
