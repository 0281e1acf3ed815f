"""Paths past a solid, in the solid's frame, at any speed and angle: distances, and the first contact."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.laws.contact import (
    BALL_ADVANCEMENTS,
    BOX,
    CAPSULE,
    LEAST_STEP,
    MAX_ADVANCEMENTS,
    MESH,
    MOST_SLIDES,
    UNSEEN,
    box_surface,
    capsule_surface,
    mesh_surface,
    toward,
    without_approach,
)
from balloon_warp.kernels.tables import Solid


@wp.func
def surface_of_convex(solid: Solid, up: wp.vec3, point: wp.vec3, radius: float, farthest: float):
    """Return the signed distance to a convex solid [m], less its thickness and a radius, and the normal.

    The point is in the solid's frame.
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
    return distance - solid.thickness - radius, normal


@wp.func
def surface_of_solid(solid: Solid, up: wp.vec3, point: wp.vec3, radius: float, farthest: float):
    """Return the same of any solid; the distance to a mesh is very large beyond `farthest`."""
    if solid.kind == MESH:
        distance, normal = mesh_surface(solid.mesh, solid.closed, point, farthest, solid.reach, solid.blur)
        return distance - solid.thickness - radius, normal
    of_convex, out_of_convex = surface_of_convex(solid, up, point, radius, farthest)
    return of_convex, out_of_convex


def surface_function(meshes: bool) -> Any:
    """Return the function that measures the distance to a solid's surface.

    Args:
        meshes: whether any is a mesh.
    """
    return surface_of_solid if meshes else surface_of_convex


DEEPER = wp.constant(4.0)
"""Depth above which a path that touches enters the solid, and does not slide along a side, over float32's resolution"""


@wp.struct
class Touch:
    """Contact of a straight path with a solid."""

    normal: wp.vec3  # of its surface where the way comes in, zero if it does not
    place: wp.vec3  # on the surface there
    clear: wp.vec3  # a place of the way before that
    part: float  # of the way up to there


@wp.func
def first_contact_with_convex(solid: Solid, up: wp.vec3, start: wp.vec3, end: wp.vec3, radius: float):
    """Return the first contact of a straight path with a convex solid, in the solid's frame.

    Along a line the distance to a convex solid is a convex function. So Newton's method converges to its first
    zero, and never past it, at any angle. A path that comes to an edge and goes on along a side is outside.
    """
    touch = Touch()
    path_length = wp.length(end - start)
    if not (path_length > 0.0):
        return touch
    ahead = (end - start) / path_length
    near = LEAST_STEP * (path_length + wp.length(start))
    gone = float(0.0)
    iterations = wp.int32(0)
    while iterations < MAX_ADVANCEMENTS:
        here = start + gone * ahead
        distance, normal = surface_of_convex(solid, up, here, radius, path_length)
        falling = -wp.dot(normal, ahead)
        iterations += 1
        if distance - falling * (path_length - gone) >= -near:  # all the rest is outside
            iterations = MAX_ADVANCEMENTS
        elif distance > near and iterations < MAX_ADVANCEMENTS:
            gone += distance / falling
        else:
            further = wp.min(gone + (wp.max(distance, 0.0) + DEEPER * near) / falling, path_length)
            depth, _normal = surface_of_convex(solid, up, start + further * ahead, radius, path_length)
            if distance < -near or depth < -near or iterations == MAX_ADVANCEMENTS:
                touch.normal = normal
                touch.place = here - distance * normal
                touch.clear = here
                touch.part = gone / path_length
                iterations = MAX_ADVANCEMENTS
            else:
                gone = further
    return touch


@wp.func
def first_contact_with_mesh(solid: Solid, up: wp.vec3, start: wp.vec3, end: wp.vec3, radius: float, farthest: float):
    """Return the first contact of a straight path with a mesh, in the mesh's frame.

    A ray finds where the moving center would pass triangles, and no angle is too small for it. Up to there
    distance queries, as far apart as the surface is away (Hart 1996, *Sphere tracing*), but at least half the skin
    or a fraction of the path, find where its skin comes in.
    """
    touch = Touch()
    path_length = wp.length(end - start)
    if not (path_length > 0.0):
        return touch
    ahead = (end - start) / path_length
    skin = solid.thickness + radius
    near = LEAST_STEP * (path_length + solid.reach)
    first, facing = surface_of_solid(solid, up, start, radius, farthest)
    ray = wp.mesh_query_ray(solid.mesh, start, ahead, path_length + near)
    passing = wp.where(ray.result, ray.t, path_length)
    inside = bool(False)
    if solid.closed != 0:
        inside = first + skin < -near or (ray.result and wp.dot(ray.normal, ahead) > 0.0)
        if first + skin <= near and not ray.result:  # it is on the surface, as float32 sees it
            last, _normal = surface_of_solid(solid, up, start + path_length * ahead, radius, farthest)
            inside = inside or last + skin < 0.0
    if inside:
        touch.normal = facing
        touch.place = start - first * facing
        touch.clear = touch.place
    else:
        unseen = near + UNSEEN * skin - wp.min(first, 0.0)
        iterations = wp.where(
            radius > 0.0, BALL_ADVANCEMENTS, MAX_ADVANCEMENTS
        )  # a ray tells all of a particle, not of a ball
        step = wp.max(0.5 * skin, path_length / float(iterations))
        before = float(0.0)
        gone = wp.max(first, step)
        while skin > 0.0 and gone < passing:
            here = start + gone * ahead
            distance, normal = surface_of_solid(solid, up, here, radius, farthest)
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
        touch.part = before / path_length
    return touch


SAME_SIDE = wp.constant(0.1)
"""Dot product of the normals at both ends of a path above which both are usually on one side of a mesh"""
ONE_PLANE = wp.constant(0.02)
"""Sine of the angle of two normals below which rounding may decide the direction of their crease: see `BLURRED`"""


@wp.func
def raised(end: wp.vec3, touch: Touch, lift: float):
    """Return the end of a path that slides on from its contact, a little above the surface [m]."""
    return end + wp.max(wp.dot(touch.place - end, touch.normal) + lift, 0.0) * touch.normal


@wp.func
def along_crease(displacement: wp.vec3, aside: wp.vec3, normal: wp.vec3, before: wp.vec3):
    """Displacement along the crease of two surfaces; `aside` where they are one plane."""
    crease = wp.cross(before, normal)
    squared = wp.length_sq(crease)
    if squared < ONE_PLANE * ONE_PLANE:
        return aside
    return wp.dot(displacement, crease) / squared * crease


@wp.func
def along_both(displacement: wp.vec3, normal: wp.vec3, before: wp.vec3):
    """Displacement along a surface; along the crease, where it enters the previous one, too."""
    aside = without_approach(displacement, wp.vec3(), normal)
    if wp.dot(aside, before) < 0.0:
        aside = along_crease(displacement, aside, normal, before)
    return aside


@wp.func
def beside_both(start: wp.vec3, end: wp.vec3, touch: Touch, before: Touch, lift: float):
    """Return the end of a path that slides on from its contact, off a second surface.

    It slides along the crease of both surfaces, where the first is in the way once more.
    """
    aside = raised(end, touch, lift)
    if wp.dot(before.place - aside, before.normal) > 0.0:
        aside = start + along_crease(end - start, aside - start, touch.normal, before.normal)
    return aside


@wp.func
def slide_on_convex(solid: Solid, up: wp.vec3, start: wp.vec3, end: wp.vec3, radius: float, farthest: float):
    """Return the end of a path that slides on from its contact with a convex solid, as its velocity does.

    Also the unit vector along which it is held back, zero if it is not, and the fraction of the path left to slide.
    """
    let = end
    outward = wp.vec3()
    part = float(1.0)
    touch = first_contact_with_convex(solid, up, start, end, radius)
    if wp.length_sq(touch.normal) > 0.0:
        outward = touch.normal
        part = 1.0 - touch.part
        let = raised(end, touch, 0.0)
    return let, outward, part


@wp.func
def slide_on_solid(solid: Solid, up: wp.vec3, start: wp.vec3, end: wp.vec3, radius: float, farthest: float):
    """Return the same of any solid.

    Beside a mesh the second path is queried as the first was. Where it enters again each time, in a wedge, it ends
    at the last place that is outside.
    """
    if solid.kind != MESH:
        let_slide, held, left = slide_on_convex(solid, up, start, end, radius, farthest)
        return let_slide, held, left
    let = end
    outward = wp.vec3()
    part = float(1.0)
    touch = first_contact_with_mesh(solid, up, start, end, radius, farthest)
    if wp.length_sq(touch.normal) > 0.0:
        outward = touch.normal
        part = 1.0 - touch.part
        lift = LEAST_STEP * (wp.length(end - start) + solid.reach)
        clear = touch.clear + lift * touch.normal
        let = raised(end, touch, lift)
        course = along_both(end - start, touch.normal, wp.vec3())
        slides = wp.int32(1)
        while slides > 0:
            distance, normal = surface_of_solid(solid, up, let, radius, farthest)
            if distance < -lift:
                let -= distance * normal
                course = along_both(course, normal, wp.vec3())
            again = first_contact_with_mesh(solid, up, clear, let, radius, farthest)
            slides += 1
            if wp.length_sq(again.normal) == 0.0:
                slides = 0
            else:
                part = 0.0
                course = along_both(course, again.normal, touch.normal)
                clear = again.clear + lift * again.normal
                let = beside_both(clear, let, again, touch, lift)
                touch = again
                if slides > MOST_SLIDES:
                    let = again.clear
                    slides = 0
        outward = toward(course - (end - start), outward)
    return let, outward, part


@wp.func
def is_straight_to_convex(
    solid: Solid,
    start: wp.vec3,
    end: wp.vec3,
    radius: float,
    first: float,
    facing: wp.vec3,
    last: float,
    normal: wp.vec3,
):
    """Return whether a path passes nothing on the way to the surface at its end.

    A convex solid has nothing above the plane of a side: so a path that begins above that of its end passes
    nothing, whichever side it enters by. A particle that slides from one box to the next, flush one, does so.
    """
    near = LEAST_STEP * (wp.length(end - start) + wp.length(start))
    return last < 0.0 and wp.dot(start - end, normal) + last >= -near


@wp.func
def is_straight_to_solid(
    solid: Solid,
    start: wp.vec3,
    end: wp.vec3,
    radius: float,
    first: float,
    facing: wp.vec3,
    last: float,
    normal: wp.vec3,
):
    """Return the same of any solid."""
    if solid.kind != MESH:
        return is_straight_to_convex(solid, start, end, radius, first, facing, last, normal)
    way = wp.length(end - start)
    skin = solid.thickness + radius
    alike = wp.dot(normal, facing) >= SAME_SIDE
    straight = alike and first + skin >= 0.0 and last + skin >= 0.0 and first + last + 2.0 * skin >= way
    if last < 0.0 and not straight and alike and (radius == 0.0 or way <= skin):
        near = LEAST_STEP * (way + solid.reach)
        above = start + near * facing
        beside = end + (near - last) * normal - above
        length = wp.length(beside)
        ray = wp.mesh_query_ray(solid.mesh, above, toward(beside, normal), length)
        straight = not ray.result
    return straight


@cache
def path_function(meshes: bool) -> Any:
    """Projection of a particle's path out of a solid, in the solid's frame.

    Args:
        meshes: whether any is a mesh.
    """
    surface_at = surface_function(meshes)
    slide, is_straight = (slide_on_solid, is_straight_to_solid) if meshes else (slide_on_convex, is_straight_to_convex)

    @wp.func
    def let_through(solid: Solid, up: wp.vec3, start: wp.vec3, end: wp.vec3, radius: float):
        """Return the end of a particle's path, on the surface if that is in the way.

        Also the unit vector along which it is held back, or zero; the clearance at the end; whether it passes an edge,
        and so slides on from its contact; and the fraction of the path that it may slide.
        """
        path_length = wp.length(end - start)
        farthest = path_length + solid.thickness + radius + 0.1 * solid.reach
        let = end
        outward = wp.vec3()
        part = float(1.0)
        slides = bool(False)
        first, facing = surface_at(solid, up, start, radius, farthest)
        free = wp.min(first, farthest) - path_length
        if first <= path_length:
            last, normal = surface_at(solid, up, end, radius, farthest)
            free = wp.min(last, farthest)
            if last < 0.0 or first + last < path_length:
                if not is_straight(solid, start, end, radius, first, facing, last, normal):
                    slid, held, left = slide(solid, up, start, end, radius, farthest)
                    let = slid
                    outward = held
                    part = left
                    slides = wp.length_sq(held) > 0.0
                if wp.length_sq(outward) == 0.0 and last < 0.0:
                    let = end - last * normal
                    outward = normal
                if wp.length_sq(outward) > 0.0:
                    free = 0.0
        return let, outward, free, slides, part

    return let_through
