"""Shapes that rays can hit: triangles, capsules (a sphere is a capsule of no length), ground and water. Y is up."""

import warp as wp

from balloon_warp.kernels.pictures.printed import Prints, printed_color


@wp.struct
class Shapes:
    """Shapes to draw, in a frame where the action is about one unit large."""

    mesh: wp.uint64
    """Triangles of all meshes; 0 where there are none"""
    corners: wp.array[wp.int32]
    """Vertex numbers, three a triangle"""
    normals: wp.array[wp.vec3]
    """Unit normals, one a vertex"""
    colors: wp.array[wp.vec3]
    """Linear RGB, one a corner: faces that share a vertex may differ there"""
    shrunk: wp.array[float]
    """Area about a vertex before over that now, one a vertex"""
    finishes: wp.array[wp.vec4]
    """Roughness, opacity, clearcoat and metallic, one a triangle"""
    prints: Prints
    """Images on triangles, in place of colors"""
    capsules: wp.uint64
    """Boxes of the capsules; 0 where there are none"""
    begins: wp.array[wp.vec3]
    ends: wp.array[wp.vec3]
    radii: wp.array[float]
    capsule_colors: wp.array[wp.vec3]
    capsule_finishes: wp.array[wp.vec4]
    reach: float
    """Distance from the origin within which all triangles and capsules are"""
    has_ground: wp.int32
    ground_height: float
    ground_color: wp.vec3
    has_water: wp.int32
    water_height: float
    water_color: wp.vec3


@wp.struct
class Hit:
    """First intersection of a ray, with `color`, `finish` and `shrunk` of the material there."""

    kind: wp.int32
    distance: float
    point: wp.vec3
    normal: wp.vec3
    color: wp.vec3
    finish: wp.vec4
    shrunk: float


LEAST_SEEN = wp.constant(0.6)
"""Least cosine of a smooth normal to the viewer, over that of its face's own"""
NOTHING = wp.constant(0)
SURFACE = wp.constant(1)
LINE = wp.constant(2)
GROUND = wp.constant(3)
WATER = wp.constant(4)


@wp.func
def capsule_distance(origin: wp.vec3, direction: wp.vec3, begin: wp.vec3, end: wp.vec3, radius: float):
    """Return the distance along a ray of unit direction to a capsule's outside; -1 where it misses or starts inside.

    The cylinder around the axis first, then whichever round cap the ray enters.
    """
    axis = end - begin
    # From the ray's point beside the capsule's middle: from afar, a thin line's radius would drown in round-off.
    beside = wp.dot(0.5 * (begin + end) - origin, direction)
    arm = origin + beside * direction - begin
    axis_axis = wp.dot(axis, axis)
    axis_direction = wp.dot(axis, direction)
    axis_arm = wp.dot(axis, arm)
    a = axis_axis - axis_direction * axis_direction
    b = axis_axis * wp.dot(arm, direction) - axis_arm * axis_direction
    c = axis_axis * (wp.dot(arm, arm) - radius * radius) - axis_arm * axis_arm
    near_end = bool(False)
    if a > 1.0e-7 * axis_axis:
        discriminant = b * b - a * c
        if discriminant < 0.0:
            return -1.0
        t = (-b - wp.sqrt(discriminant)) / a
        along = axis_arm + t * axis_direction
        if along > 0.0 and along < axis_axis:
            return beside + t
        near_end = along >= axis_axis
    else:
        near_end = axis_direction < 0.0
    if near_end:
        arm -= axis
    half_b = wp.dot(direction, arm)
    across = arm - half_b * direction
    discriminant = radius * radius - wp.dot(across, across)
    if discriminant < 0.0:
        return -1.0
    return beside - half_b - wp.sqrt(discriminant)


@wp.func
def nearest_capsule(shapes: Shapes, origin: wp.vec3, direction: wp.vec3, reach: float):
    """Return the first capsule along a ray and its distance; number -1 where there is none within `reach`."""
    nearest = wp.int32(-1)
    distance = float(reach)
    if shapes.capsules != wp.uint64(0):
        query = wp.bvh_query_ray(shapes.capsules, origin, direction)
        capsule = wp.int32(0)
        while wp.bvh_query_next(query, capsule, distance):
            t = capsule_distance(origin, direction, shapes.begins[capsule], shapes.ends[capsule], shapes.radii[capsule])
            if t > 0.0 and t < distance:
                distance = t
                nearest = capsule
    return nearest, distance


@wp.func
def capsule_normal(shapes: Shapes, capsule: wp.int32, point: wp.vec3):
    """Return the outward unit normal of a capsule at a point on it."""
    begin = shapes.begins[capsule]
    axis = shapes.ends[capsule] - begin
    along = wp.dot(point - begin, axis) / wp.max(wp.dot(axis, axis), 1.0e-20)
    return wp.normalize(point - begin - wp.clamp(along, 0.0, 1.0) * axis)


@wp.func
def turned_to_viewer(smooth: wp.vec3, facing: wp.vec3, direction: wp.vec3):
    """Return a smooth normal, bent toward the viewer where its face is seen by much less of a slant than it says.

    Near the outline of a coarse mesh a smooth normal looks away over a whole polygon, which would be a gray shard: all
    of it mirrors as if it were seen edge-on.

    Args:
        facing: the face's own normal; both are unit vectors on the viewer's side of the face.
        direction: of the ray.
    """
    seen = -wp.dot(smooth, direction)
    least = -LEAST_SEEN * wp.dot(facing, direction)
    across = smooth + seen * direction
    length = wp.length(across)
    if seen >= least or length < 1.0e-6:
        return smooth
    return wp.sqrt(1.0 - least * least) / length * across - least * direction


@wp.func
def first_hit(shapes: Shapes, origin: wp.vec3, direction: wp.vec3, reach: float):
    """Return the first hit along a ray of unit direction, within `reach`.

    Its normal is smooth and faces the origin.
    """
    hit = Hit()
    hit.kind = NOTHING
    hit.distance = reach
    # Most rays of the ground's shadows go nowhere near anything.
    beside = wp.max(-wp.dot(origin, direction), 0.0)
    near = wp.length_sq(origin + beside * direction) < shapes.reach * shapes.reach
    if near and shapes.mesh != wp.uint64(0):
        query = wp.mesh_query_ray(shapes.mesh, origin, direction, reach)
        if query.result:
            hit.kind = SURFACE
            hit.distance = query.t
            a = shapes.corners[3 * query.face]
            b = shapes.corners[3 * query.face + 1]
            c = shapes.corners[3 * query.face + 2]
            w = 1.0 - query.u - query.v
            corner = 3 * query.face
            hit.color = query.u * shapes.colors[corner] + query.v * shapes.colors[corner + 1]
            hit.color += w * shapes.colors[corner + 2]
            if shapes.prints.of_triangle.shape[0] > 0 and shapes.prints.of_triangle[query.face] >= 0:
                place = query.u * shapes.prints.places[corner] + query.v * shapes.prints.places[corner + 1]
                place += w * shapes.prints.places[corner + 2]
                hit.color = printed_color(shapes.prints, shapes.prints.of_triangle[query.face], place)
            hit.finish = shapes.finishes[query.face]
            hit.shrunk = query.u * shapes.shrunk[a] + query.v * shapes.shrunk[b] + w * shapes.shrunk[c]
            smooth = query.u * shapes.normals[a] + query.v * shapes.normals[b] + w * shapes.normals[c]
            facing = query.normal
            if wp.dot(facing, direction) > 0.0:
                facing = -facing
            if wp.dot(smooth, facing) < 0.0:
                smooth = -smooth
            hit.normal = turned_to_viewer(wp.normalize(smooth), facing, direction)
    capsule = wp.int32(-1)
    distance = float(0.0)
    if near:
        capsule, distance = nearest_capsule(shapes, origin, direction, hit.distance)
    if capsule >= 0:
        is_ball = shapes.begins[capsule] == shapes.ends[capsule]
        hit.kind = wp.where(is_ball, SURFACE, LINE)
        hit.distance = distance
        hit.normal = capsule_normal(shapes, capsule, origin + distance * direction)
        hit.color = shapes.capsule_colors[capsule]
        hit.finish = shapes.capsule_finishes[capsule]
        hit.shrunk = 1.0
    if shapes.has_ground != 0 and direction[1] * (origin[1] - shapes.ground_height) < 0.0:
        t = (shapes.ground_height - origin[1]) / direction[1]
        if t < hit.distance:
            hit.kind = GROUND
            hit.distance = t
            hit.normal = wp.vec3(0.0, wp.where(direction[1] < 0.0, 1.0, -1.0), 0.0)
            hit.color = shapes.ground_color
            hit.finish = wp.vec4(1.0, 1.0, 0.0, 0.0)
    hit.point = origin + hit.distance * direction
    return hit


@wp.func
def water_before(shapes: Shapes, origin: wp.vec3, direction: wp.vec3, hit: Hit):
    """Return the water's surface where a ray meets it first, else the given hit.

    Not a part of `first_hit`, since things under water are lit as if there were none.
    """
    if shapes.has_water != 0 and direction[1] * (origin[1] - shapes.water_height) < 0.0:
        t = (shapes.water_height - origin[1]) / direction[1]
        if t < hit.distance:
            hit.kind = WATER
            hit.distance = t
            hit.point = origin + t * direction
            hit.normal = wp.vec3(0.0, wp.where(direction[1] < 0.0, 1.0, -1.0), 0.0)
            hit.color = shapes.water_color
    return hit
