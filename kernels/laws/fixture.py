"""Contact with an obstacle of prescribed motion: its shapes as signed distances, and the response of a particle.

The distance is that to the surface, negative inside, less the obstacle's thickness; its gradient is the normal. A
particle that a step has brought inside stands on the surface where it came in, and is slowed as by the ground, see
`laws.contact.stand_on`: so it begins to slide on a slope of atan(friction), and slides with
g (sin - friction cos). No energy is gained, but by the motion of an obstacle.

Distances of box and capsule: Quilez, *3D signed distance functions* (iquilezles.org, "distfunctions").
"""

import warp as wp

BOX, CAPSULE, PLANE, MESH = wp.constant(0), wp.constant(1), wp.constant(2), wp.constant(3)
"""Kinds of shapes"""
SHAPES = ("box", "capsule", "plane", "mesh")
"""Names of the kinds of shapes, by their numbers"""
FAR_AWAY = wp.constant(1.0e30)
"""Distance of a mesh that a query did not find within its range [m]"""
MOST_LOOKS = wp.constant(32)
"""Largest number of distance queries along a path that may enter a solid"""
BALL_LOOKS = wp.constant(256)
"""Largest number of distance queries along a sphere's path beside a mesh"""
MOST_TURNS = wp.constant(4)
"""Largest number of passes over all solids in a path in a step, as one may push the path's end into another"""
SETTLED = wp.constant(1.0e-3)
"""Displacement of a path's end below which it counts as settled, over the path's length"""
MOST_SLIDES = wp.constant(3)
"""Largest number of slides of a particle along a mesh in a step"""
UNSEEN = wp.constant(0.02)
"""Depth of entry that may be missed between queries, over a mesh's skin"""
BLURRED = wp.constant(3.0e-5)
"""Distance to a mesh's surface, over the mesh's extent, below which float32 does not resolve the direction"""
LEAST_STEP = wp.constant(2.0e-6)
"""Shortest step along a path, over its length, that float32 resolves"""


@wp.func
def is_settled(start: wp.vec3, end: wp.vec3, point: wp.vec3):
    """Return whether solids in a path have hardly moved the path's end."""
    return wp.length(point - end) <= SETTLED * wp.length(end - start) + LEAST_STEP * wp.length(point)


@wp.func
def toward(arm: wp.vec3, otherwise: wp.vec3):
    """Return the direction of an arm, a unit vector; `otherwise` where there is none."""
    if wp.length_sq(arm) > 0.0:
        return wp.normalize(arm)
    return otherwise


@wp.func
def box_surface(point: wp.vec3, half: wp.vec3):
    """Return the distance to a box [m], and its normal; half its edges are given."""
    beyond = wp.vec3(wp.abs(point[0]) - half[0], wp.abs(point[1]) - half[1], wp.abs(point[2]) - half[2])
    signs = wp.vec3(
        wp.where(point[0] < 0.0, -1.0, 1.0), wp.where(point[1] < 0.0, -1.0, 1.0), wp.where(point[2] < 0.0, -1.0, 1.0)
    )
    inside = wp.max(beyond)
    if inside > 0.0:
        outside = wp.vec3(wp.max(beyond[0], 0.0), wp.max(beyond[1], 0.0), wp.max(beyond[2], 0.0))
        return wp.length(outside), toward(wp.cw_mul(outside, signs), signs)
    normal = wp.vec3(0.0, 0.0, signs[2])
    if inside == beyond[0]:
        normal = wp.vec3(signs[0], 0.0, 0.0)
    elif inside == beyond[1]:
        normal = wp.vec3(0.0, signs[1], 0.0)
    return inside, normal


@wp.func
def capsule_surface(point: wp.vec3, radius: float, half_length: float, up: wp.vec3):
    """Return the distance to a capsule along the up axis [m], and its normal."""
    arm = point - wp.clamp(wp.dot(point, up), -half_length, half_length) * up
    across = wp.vec3(up[1], up[2], up[0])
    return wp.length(arm) - radius, toward(arm, across)


@wp.func
def mesh_normal(arm: wp.vec3, face_normal: wp.vec3, side: float, reach: float):
    """Return the direction of the arm from the nearest place of a mesh to a point, a unit vector, turned to a side.

    It is that face's normal where float32 would tell no direction.
    """
    if wp.length_sq(arm) > (BLURRED * reach) * (BLURRED * reach):
        return side * wp.normalize(arm)
    return face_normal


@wp.func
def mesh_surface(mesh: wp.uint64, closed: wp.int32, point: wp.vec3, farthest: float, reach: float, blur: float):
    """Return the distance to a mesh [m], and its normal; `FAR_AWAY` where there is nothing within `farthest`.

    A sheet has two sides: its normal is on that of the point.
    """
    if closed != 0:
        found = wp.mesh_query_point_sign_normal(mesh, point, farthest, blur)
        if found.result:
            arm = point - wp.mesh_eval_position(mesh, found.face, found.u, found.v)
            normal = mesh_normal(arm, wp.mesh_eval_face_normal(mesh, found.face), found.sign, reach)
            return found.sign * wp.length(arm), normal
        return FAR_AWAY, wp.vec3()
    seen = wp.mesh_query_point_no_sign(mesh, point, farthest)
    if seen.result:
        arm = point - wp.mesh_eval_position(mesh, seen.face, seen.u, seen.v)
        facing = wp.mesh_eval_face_normal(mesh, seen.face)
        normal = mesh_normal(arm, wp.where(wp.dot(arm, facing) < 0.0, -facing, facing), 1.0, reach)
        return wp.length(arm), normal
    return FAR_AWAY, wp.vec3()
