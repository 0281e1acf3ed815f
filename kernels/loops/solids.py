"""Solids as seen from themselves: how far their surfaces are."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.contact_tables import Solid
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
    """Return the function that measures the distance to a solid's surface.

    Args:
        meshes: whether any is a mesh.
    """

    @wp.func
    def surface_at(solid: Solid, up: wp.vec3, point: wp.vec3, radius: float, farthest: float):
        """Return the signed distance to a solid [m], less its thickness and a radius, and the normal.

        The point is in the solid's frame. For a mesh, the distance is very large beyond `farthest`.
        """
        distance = wp.dot(point, up)
        normal = up
        if solid.kind == BOX:
            of_box, out_of_box = box_surface(point, solid.size)
            distance = of_box
            normal = out_of_box
        elif solid.kind == CAPSULE:
            of_capsule, out_of_capsule = capsule_surface(point, solid.size[0], solid.size[1], up)
            distance = of_capsule
            normal = out_of_capsule
        if wp.static(meshes):
            if solid.kind == MESH:
                of_mesh, out_of_mesh = mesh_surface(
                    solid.mesh, solid.closed, point, farthest, solid.reach, solid.blur
                )  # fmt: skip
                distance = of_mesh
                normal = out_of_mesh
        return distance - solid.thickness - radius, normal

    return surface_at
