"""Polygon meshes: reading, writing, measuring and remeshing them."""

from balloon_warp.mesh.polygon_mesh import PolygonMesh

__all__ = ["PolygonMesh"]
