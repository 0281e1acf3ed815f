"""The polygon mesh that every other part of the package speaks of."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.looks import Looks
from balloon_warp.shown import Shown, described


@described
@dataclass(frozen=True, repr=False)
class PolygonMesh(Shown):
    """A mesh of polygons of any size, named as in USD. The n-th point is the n-th vertex of the file."""

    points: NDArray[np.float64]
    """Positions in the file's units, shape (vertex_count, 3)"""
    face_vertex_counts: NDArray[np.int32]
    """Number of corners of each face, shape (face_count,)"""
    face_vertex_indices: NDArray[np.int32]
    """Corners of all faces in order, indices into `points`, shape (face_vertex_counts.sum(),)"""
    name: str = "mesh"
    """Name of the file or the prim"""
    up_axis: str = "Y"
    """Axis that points up in the file: "Y" or "Z" """
    up_known: bool = False
    """Whether the up axis is given, by the file or the caller; else it is a guess"""
    meters_per_unit: float = 1.0
    """Meters in one unit of `points`"""
    unit_known: bool = False
    """Whether the unit is given, by the file or the caller; else it is a guess"""
    texture_coordinates: NDArray[np.float32] | None = None
    """Texture coordinates u and v at each corner, shape (corner_count, 2), if the file has them"""
    looks: Looks | None = None
    """Colors and images, if the file has some"""
    stand_ins: NDArray[np.int64] | None = None
    """Vertex that faces have in place of each vertex, itself where it was not welded, shape (vertex_count,); None where
    nothing was"""
    warnings: tuple[str, ...] = field(default=())
    """Warnings of the reader, a sentence each"""
    groups: Mapping[str, NDArray[np.int32]] = field(default_factory=dict)
    """Vertices by the names that the file has for parts of the mesh, each ascending: groups and objects of an OBJ file,
    subsets of USD"""

    def __repr__(self) -> str:
        return f"PolygonMesh({self.name!r}, {self.vertex_count} vertices, {self.face_count} faces)"

    @property
    def vertex_count(self) -> int:
        return len(self.points)

    @property
    def face_count(self) -> int:
        return len(self.face_vertex_counts)

    def stand_in(self, vertex: int) -> int:
        """Find the vertex that faces use instead of this vertex of the file."""
        return vertex if self.stand_ins is None else int(self.stand_ins[vertex])

    @property
    def left_vertices(self) -> NDArray[np.int64]:
        """Vertices that faces have left for others, in order."""
        own = np.arange(self.vertex_count)
        return np.flatnonzero((own if self.stand_ins is None else self.stand_ins) != own)
