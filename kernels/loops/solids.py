"""Solids as seen from themselves: how far their surfaces are, and where they let a particle go, or a ball."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.contact_tables import SolidTable
from balloon_warp.kernels.laws.fixture import (
    BOX,
    CAPSULE,
    LEAST_STEP,
    MESH,
    MOST_LOOKS,
    box_surface,
    capsule_surface,
    mesh_surface,
    toward,
)

OTHER_SIDE = wp.constant(0.1)
"""product of two normals, of which the one may be on another side of something"""


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
                    shapes.meshes[number], shapes.closed[number], point, farthest, shapes.reaches[number]
                )
                distance = of_mesh
                normal = out_of_mesh
        return distance - shapes.thicknesses[number] - radius, normal

    return surface_at


@cache
def way_function(meshes: bool) -> Any:
    """The function that says where a solid lets a particle go, as seen from the solid."""
    surface_at = surface_function(meshes)

    @wp.func
    def stopped_on_the_way(
        shapes: SolidTable,
        up: wp.vec3,
        number: wp.int32,
        start: wp.vec3,
        end: wp.vec3,
        radius: float,
        first: float,
        farthest: float,
    ):
        """Where a particle first came inside that may have gone through: its place on the surface there, the normal,
        zero if nowhere, and what part of its way that is. As far as the surface is away, it may go unseen (Hart 1996,
        *Sphere tracing*)."""
        way = wp.length(end - start)
        least = LEAST_STEP * (way + wp.length(start))
        ahead = toward(end - start, up)
        gone = wp.max(first, 0.0)
        stop = end
        outward = wp.vec3()
        looks = wp.int32(0)
        reached = float(1.0)
        while gone < way and looks < MOST_LOOKS:
            here = start + gone * ahead
            distance, normal = surface_at(shapes, up, number, here, radius, farthest)
            reached_here = gone / way
            gone += wp.max(distance, least / wp.max(-wp.dot(normal, ahead), 0.01))
            looks += 1
            if distance < 0.0:
                stop = here - distance * normal
                outward = normal
                reached = reached_here
                looks = MOST_LOOKS
        return stop, outward, wp.min(reached, 1.0)

    @wp.func
    def let_through(shapes: SolidTable, up: wp.vec3, number: wp.int32, start: wp.vec3, end: wp.vec3, radius: float):
        """The end of a particle's way, on the surface if that is in it; then the normal there, or else zero; how far
        from the end there is nothing for sure; and what part of its way it went."""
        way = wp.length(end - start)
        farthest = way + shapes.thicknesses[number] + radius + 0.1 * shapes.reaches[number]
        let = end
        outward = wp.vec3()
        part = float(1.0)
        first, facing = surface_at(shapes, up, number, start, radius, farthest)
        free = wp.min(first, farthest) - way
        if first <= way:
            last, normal = surface_at(shapes, up, number, end, radius, farthest)
            free = wp.min(last, farthest)
            if wp.dot(normal, facing) < OTHER_SIDE:
                stop, there, reached = stopped_on_the_way(shapes, up, number, start, end, radius, first, farthest)
                outward = there
                if wp.length_sq(there) > 0.0:  # it slides on from where it came in, as its speed does
                    let = end + wp.max(wp.dot(stop - end, there), 0.0) * there
                    beyond, _side = surface_at(shapes, up, number, let, radius, farthest)
                    if beyond < 0.0:
                        let = stop
                        part = reached
            if wp.length_sq(outward) == 0.0 and last < 0.0:
                let = end - last * normal
                outward = normal
            if wp.length_sq(outward) > 0.0:
                free = 0.0
        return let, outward, free, part

    return let_through
