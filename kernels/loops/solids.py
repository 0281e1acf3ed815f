"""Solids as seen from themselves: how far their surfaces are."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.contact_tables import SolidTable
from balloon_warp.kernels.laws.fixture import (
    BOX,
    CAPSULE,
    MESH,
    box_surface,
    capsule_surface,
    mesh_surface,
)


@cache
def surface_function(meshes: bool) -> Any:
    """The function that measures the distance to a solid's surface.

    Args:
        meshes: whether any is a mesh.
    """

    @wp.func
    def surface_at(shapes: SolidTable, up: wp.vec3, number: wp.int32, point: wp.vec3, radius: float, farthest: float):
        """Signed [m], less the solid's thickness and a radius, and the normal; the point is seen from the solid.
        Of a mesh, very large beyond `farthest`."""
        kind = shapes.kinds[number]
        size = shapes.sizes[number]
        distance = wp.dot(point, up)
        normal = up
        if kind == BOX:
            of_box, out_of_box = box_surface(point, size)
            distance = of_box
            normal = out_of_box
        elif kind == CAPSULE:
            of_capsule, out_of_capsule = capsule_surface(point, size[0], size[1], up)
            distance = of_capsule
            normal = out_of_capsule
        if wp.static(meshes):
            if kind == MESH:
                of_mesh, out_of_mesh = mesh_surface(
                    shapes.meshes[number],
                    shapes.closed[number],
                    point,
                    farthest,
                    shapes.reaches[number],
                    shapes.blurs[number],
                )
                distance = of_mesh
                normal = out_of_mesh
        return distance - shapes.thicknesses[number] - radius, normal

    return surface_at
