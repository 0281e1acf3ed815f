"""First contact of a straight path with a solid, in the solid's frame, at any speed and angle."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.contact_tables import Solid
from balloon_warp.kernels.laws.fixture import BALL_LOOKS, LEAST_STEP, MESH, MOST_LOOKS, UNSEEN
from balloon_warp.kernels.loops.solids import surface_function

DEEPER = wp.constant(4.0)
"""Depth above which a path that touches enters the solid, and does not slide along a side, over float32's resolution"""


@wp.struct
class Touch:
    """Contact of a straight path with a solid."""

    normal: wp.vec3  # of its surface where the way comes in, zero if it does not
    place: wp.vec3  # on the surface there
    clear: wp.vec3  # a place of the way before that
    part: float  # of the way up to there


@cache
def convex_function(meshes: bool) -> Any:
    """Make the function that says where a straight way comes into a convex solid first.

    Args:
        meshes: whether any solid is a mesh.
    """
    surface_at = surface_function(meshes)

    @wp.func
    def touch_convex(solid: Solid, up: wp.vec3, start: wp.vec3, way: float, ahead: wp.vec3, radius: float):
        """Return the first contact with a convex solid.

        Along a line the distance to a convex solid is a convex function. So Newton's method converges to its first
        zero, and never past it, at any angle. A path that comes to an edge and goes on along a side is outside.
        """
        touch = Touch()
        near = LEAST_STEP * (way + wp.length(start))
        gone = float(0.0)
        looks = wp.int32(0)
        while looks < MOST_LOOKS:
            here = start + gone * ahead
            distance, normal = surface_at(solid, up, here, radius, way)
            falling = -wp.dot(normal, ahead)
            looks += 1
            if distance - falling * (way - gone) >= -near:  # all the rest is outside
                looks = MOST_LOOKS
            elif distance > near and looks < MOST_LOOKS:
                gone += distance / falling
            else:
                further = wp.min(gone + (wp.max(distance, 0.0) + DEEPER * near) / falling, way)
                depth, _normal = surface_at(solid, up, start + further * ahead, radius, way)
                if distance < -near or depth < -near or looks == MOST_LOOKS:
                    touch.normal = normal
                    touch.place = here - distance * normal
                    touch.clear = here
                    touch.part = gone / way
                    looks = MOST_LOOKS
                else:
                    gone = further
        return touch

    return touch_convex


@cache
def mesh_function() -> Any:
    """Make the function that says where a straight way comes into a mesh first."""
    surface_at = surface_function(True)

    @wp.func
    def touch_mesh(
        solid: Solid,
        up: wp.vec3,
        start: wp.vec3,
        way: float,
        ahead: wp.vec3,
        radius: float,
        farthest: float,
    ):
        """Return the first contact with a mesh.

        A ray finds where the moving center would pass triangles, and no angle is too small for it. Up to there
        distance queries, as far apart as the surface is away (Hart 1996, *Sphere tracing*), but at least half the skin
        or a fraction of the path, find where its skin comes in.
        """
        touch = Touch()
        skin = solid.thickness + radius
        near = LEAST_STEP * (way + solid.reach)
        first, facing = surface_at(solid, up, start, radius, farthest)
        ray = wp.mesh_query_ray(solid.mesh, start, ahead, way + near)
        passing = wp.where(ray.result, ray.t, way)
        inside = bool(False)
        if solid.closed != 0:
            inside = first + skin < -near or (ray.result and wp.dot(ray.normal, ahead) > 0.0)
            if first + skin <= near and not ray.result:  # it is on the surface, as float32 sees it
                last, _normal = surface_at(solid, up, start + way * ahead, radius, farthest)
                inside = inside or last + skin < 0.0
        if inside:
            touch.normal = facing
            touch.place = start - first * facing
            touch.clear = start
        else:
            unseen = near + UNSEEN * skin - wp.min(first, 0.0)
            looks = wp.where(radius > 0.0, BALL_LOOKS, MOST_LOOKS)  # a ray tells all of a particle, not of a ball
            step = wp.max(0.5 * skin, way / float(looks))
            before = float(0.0)
            gone = wp.max(first, step)
            while skin > 0.0 and gone < passing:
                here = start + gone * ahead
                distance, normal = surface_at(solid, up, here, radius, farthest)
                if distance < -unseen:
                    touch.normal = normal
                    touch.place = here - distance * normal
                    gone = passing
                else:
                    before = gone
                    gone += wp.max(distance, step)
            if ray.result and wp.length_sq(touch.normal) == 0.0:
                normal = wp.where(wp.dot(ray.normal, ahead) > 0.0, -ray.normal, ray.normal)
                touch.normal = normal
                touch.place = start + passing * ahead + skin * normal
                before = wp.max(before, passing - (skin + near) / wp.max(-wp.dot(normal, ahead), LEAST_STEP))
            touch.clear = start + before * ahead
            touch.part = before / way
        return touch

    return touch_mesh


@cache
def touch_function(meshes: bool) -> Any:
    """Return the function that returns the first contact of a straight path with a solid, in the solid's frame.

    Args:
        meshes: whether any is a mesh.
    """
    touch_convex = convex_function(meshes)
    touch_mesh = mesh_function() if meshes else None

    @wp.func
    def touch_at(solid: Solid, up: wp.vec3, start: wp.vec3, end: wp.vec3, radius: float, farthest: float):
        """Return the first contact of the path from a start to an end."""
        way = wp.length(end - start)
        touch = Touch()
        if way > 0.0:
            ahead = (end - start) / way
            if wp.static(meshes):
                if solid.kind == MESH:
                    touch = touch_mesh(solid, up, start, way, ahead, radius, farthest)
                else:
                    touch = touch_convex(solid, up, start, way, ahead, radius)
            else:
                touch = touch_convex(solid, up, start, way, ahead, radius)
        return touch

    return touch_at
