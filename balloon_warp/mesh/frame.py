"""The axes and the unit of a mesh."""

from dataclasses import replace

from balloon_warp.mesh.polygon_mesh import PolygonMesh


def in_y_up_meters(mesh: PolygonMesh) -> PolygonMesh:
    """The mesh in meters, y up, which is how an OBJ file is taken."""
    points = mesh.points * mesh.meters_per_unit
    if mesh.up_axis == "Z":
        points = points[:, [0, 2, 1]] * [1.0, 1.0, -1.0]
    return replace(mesh, points=points, up_axis="Y", meters_per_unit=1.0)
