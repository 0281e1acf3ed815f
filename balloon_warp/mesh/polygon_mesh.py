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
    """positions, in the file's units, shape (vertex_count, 3)"""
    face_vertex_counts: NDArray[np.int32]
    """corners of each face, shape (face_count,)"""
    face_vertex_indices: NDArray[np.int32]
    """corners of all faces in order, indices into `points`, shape (face_vertex_counts.sum(),)"""
    name: str = "mesh"
    """what the file or the prim is called"""
    up_axis: str = "Y"
    """the axis that points up in the file: "Y" or "Z" """
    up_known: bool = False
    """whether that is said, by the file or by whoever gives it; else it is a guess"""
    meters_per_unit: float = 1.0
    """metres in one unit of `points`"""
    unit_known: bool = False
    """whether that is said, by the file or by whoever gives it; else it is a guess"""
    texture_coordinates: NDArray[np.float32] | None = None
    """u and v at each corner, shape (corner_count, 2), if the file has them"""
    looks: Looks | None = None
    """colors and images, if the file has some"""
    stand_ins: NDArray[np.int64] | None = None
    """for each vertex the one that faces have in its place, itself where it was not welded, shape (vertex_count,); None
    where nothing was"""
    warnings: tuple[str, ...] = field(default=())
    """what the reader had to put up with, a sentence each"""
    groups: Mapping[str, NDArray[np.int32]] = field(default_factory=dict)
    """vertices by the names that the file has for parts of the mesh, each ascending: of an OBJ file its groups and
    objects, of USD its subsets"""

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
