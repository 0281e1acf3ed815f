"""Paths of particles and balls past a solid, in the solid's frame, at any speed and angle."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.contact_tables import Solid
from balloon_warp.kernels.laws.contact import without_approach
from balloon_warp.kernels.laws.fixture import LEAST_STEP, MESH, MOST_SLIDES, toward
from balloon_warp.kernels.loops.first_touch import Touch, touch_function
from balloon_warp.kernels.loops.solids import surface_function

SAME_SIDE = wp.constant(0.1)
"""Dot product of the normals at both ends of a path above which both are usually on one side of a mesh"""

ONE_PLANE = wp.constant(0.02)
"""Sine of the angle of two normals below which rounding may decide the direction of their crease: see `BLURRED`"""


@wp.func
def raised(end: wp.vec3, touch: Touch, lift: float):
    """Return the end of a path that slides on from its contact, a little above the surface [m]."""
    return end + wp.max(wp.dot(touch.place - end, touch.normal) + lift, 0.0) * touch.normal


@wp.func
def along_crease(course: wp.vec3, aside: wp.vec3, normal: wp.vec3, before: wp.vec3):
    """Return the part of a course along the crease of two surfaces; `aside` where they are one plane."""
    crease = wp.cross(before, normal)
    squared = wp.length_sq(crease)
    if squared < ONE_PLANE * ONE_PLANE:
        return aside
    return wp.dot(course, crease) / squared * crease


@wp.func
def along_both(course: wp.vec3, normal: wp.vec3, before: wp.vec3):
    """Return the part of a course along a surface; along the crease, where that goes into the previous one, too."""
    aside = without_approach(course, wp.vec3(), normal)
    if wp.dot(aside, before) < 0.0:
        aside = along_crease(course, aside, normal, before)
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


@cache
def slide_function(meshes: bool) -> Any:
    """Return the function that returns the end of a path that a solid may block, in the solid's frame."""
    surface_at = surface_function(meshes)
    touch_at = touch_function(meshes)

    @wp.func
    def slide(solid: Solid, up: wp.vec3, start: wp.vec3, end: wp.vec3, radius: float, farthest: float):
        """Return the end of a path that slides on from its contact, as its velocity does.

        Also the unit vector along which it is held back, zero if it is not, and the fraction of the path left to slide.

        Beside a mesh the second path is queried as the first was. Where it enters again each time, in a wedge, it ends
        at the last place that is outside.
        """
        let = end
        outward = wp.vec3()
        part = float(1.0)
        touch = touch_at(solid, up, start, end, radius, farthest)
        if wp.length_sq(touch.normal) > 0.0:
            outward = touch.normal
            part = 1.0 - touch.part
            if wp.static(not meshes) or solid.kind != MESH:
                let = raised(end, touch, 0.0)
            else:
                lift = LEAST_STEP * (wp.length(end - start) + solid.reach)
                clear = touch.clear + lift * touch.normal
                let = raised(end, touch, lift)
                course = along_both(end - start, touch.normal, wp.vec3())
                slides = wp.int32(1)
                while slides > 0:
                    distance, normal = surface_at(solid, up, let, radius, farthest)
                    if distance < -lift:
                        let -= distance * normal
                        course = along_both(course, normal, wp.vec3())
                    again = touch_at(solid, up, clear, let, radius, farthest)
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

    return slide


@cache
def way_function(meshes: bool) -> Any:
    """Return the function that returns a particle's place outside of a solid, in the solid's frame."""
    surface_at = surface_function(meshes)
    slide = slide_function(meshes)

    @wp.func
    def is_straight(
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
        way = wp.length(end - start)
        near = LEAST_STEP * (way + wp.length(start))
        straight = last < 0.0 and wp.dot(start - end, normal) + last >= -near
        if wp.static(meshes):
            if solid.kind == MESH:
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

    @wp.func
    def let_through(solid: Solid, up: wp.vec3, start: wp.vec3, end: wp.vec3, radius: float):
        """Return the end of a particle's path, on the surface if that is in the way.

        Also the unit vector along which it is held back, or zero; the clearance at the end; whether it passes an edge,
        and so slides on from its contact; and the fraction of the path that it may slide.
        """
        way = wp.length(end - start)
        farthest = way + solid.thickness + radius + 0.1 * solid.reach
        let = end
        outward = wp.vec3()
        part = float(1.0)
        slides = bool(False)
        first, facing = surface_at(solid, up, start, radius, farthest)
        free = wp.min(first, farthest) - way
        if first <= way:
            last, normal = surface_at(solid, up, end, radius, farthest)
            free = wp.min(last, farthest)
            if last < 0.0 or first + last < way:
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
