"""A liquid under a level surface: pressure and drag on the wetted part of each face, cut exactly at the surface.

A face is the fan of triangles about its center. Depth is linear over a triangle, and a corner takes of the pressure and
of the wetted area what its barycentric coordinate weighs, the center's part being shared out evenly to the face's
corners: so force and torque are those of the hydrostatic pressure on the fan (Kim et al. 2006).
"""

from typing import Any

import warp as wp

from balloon_warp.kernels.inflation import face_center
from balloon_warp.kernels.motion import response
from balloon_warp.kernels.tables import BodyTable, FaceTable, WaterTable, particle_mass, row_of_world


@wp.func
def corner_shares(depths: wp.vec3):
    """Of the piece that the surface cuts off a triangle at its first corner, which alone is wet, or alone is dry: the
    integrals of depth times each barycentric coordinate [m], and of each coordinate, over the triangle's area."""
    along = depths[0] / (depths[0] - depths[1])
    across = depths[0] / (depths[0] - depths[2])
    piece = along * across
    moments = (piece * depths[0] / 12.0) * wp.vec3(4.0 - along - across, along, across)
    areas = (piece / 3.0) * wp.vec3(3.0 - along - across, along, across)
    return moments, areas


@wp.func
def lone_corner(depths: wp.vec3, wet: bool):
    """The corner that alone is wet, or alone is dry."""
    if (depths[0] > 0.0) == wet:
        return 0
    if (depths[1] > 0.0) == wet:
        return 1
    return 2


@wp.func
def wet_shares(depths: wp.vec3):
    """Of the wetted part of a triangle with these depths at its corners [m]: the integrals of depth times each
    barycentric coordinate [m], and of each coordinate, over the triangle's area."""
    wet = wp.where(depths[0] > 0.0, 1, 0) + wp.where(depths[1] > 0.0, 1, 0) + wp.where(depths[2] > 0.0, 1, 0)
    moments = wp.vec3()
    areas = wp.vec3()
    if wet > 1:
        moments = (wp.vec3(depths[0] + depths[1] + depths[2]) + depths) / 12.0
        areas = wp.vec3(1.0 / 3.0)
    if wet == 1 or wet == 2:
        a = lone_corner(depths, wet == 1)
        b = (a + 1) % 3
        c = (a + 2) % 3
        corner_moments, corner_areas = corner_shares(wp.vec3(depths[a], depths[b], depths[c]))
        sign = wp.where(wet == 1, 1.0, -1.0)
        moments[a] += sign * corner_moments[0]
        moments[b] += sign * corner_moments[1]
        moments[c] += sign * corner_moments[2]
        areas[a] += sign * corner_areas[0]
        areas[b] += sign * corner_areas[1]
        areas[c] += sign * corner_areas[2]
    return moments, areas


@wp.struct
class TriangleLoad:
    """What the corners of a triangle take of its wetted part."""

    area_vector: wp.vec3
    """of the whole triangle [m^2]"""
    moments: wp.vec3
    """by corner, times the area vector: the integral of depth [m]"""
    areas: wp.vec3
    """by corner: the wetted area [m^2]"""


@wp.func
def triangle_load(a: wp.vec3, b: wp.vec3, c: wp.vec3, level: float, up: wp.vec3):
    """What water up to a level puts on a triangle."""
    load = TriangleLoad()
    moments, shares = wet_shares(wp.vec3(level - wp.dot(a, up), level - wp.dot(b, up), level - wp.dot(c, up)))
    load.area_vector = 0.5 * wp.cross(a - c, b - c)
    load.moments = moments
    load.areas = wp.length(load.area_vector) * shares
    return load


@wp.func
def corner_load(load: TriangleLoad, moment: float, area: float):
    """A corner's depth times area vector, and wetted area, as one vector."""
    return wp.vec4(moment * load.area_vector[0], moment * load.area_vector[1], moment * load.area_vector[2], area)


@wp.func
def is_dry(faces: FaceTable, points: Any, first: wp.int32, begin: wp.int32, end: wp.int32, level: float, up: wp.vec3):
    """Whether all corners of a face are above the water: then the face is."""
    lowest = wp.dot(points[first + faces.particles[begin]], up)
    for corner in range(begin + 1, end):
        lowest = wp.min(lowest, wp.dot(points[first + faces.particles[corner]], up))
    return lowest >= level


@wp.func
def particle_load(faces: FaceTable, points: Any, first: wp.int32, particle: wp.int32, level: float, up: wp.vec3):
    """A particle's depth times area vector over the wetted faces around it [m^3], and their wetted area [m^2].

    Particle p stands at `points[first + p]`.
    """
    total = wp.vec4()
    for incidence in range(faces.particle_offsets[particle], faces.particle_offsets[particle + 1]):
        face = faces.around_particles[incidence]
        begin = faces.offsets[face]
        end = faces.offsets[face + 1]
        if not is_dry(faces, points, first, begin, end, level, up):
            center = face_center(points, first, faces.particles, begin, end)
            center_total = wp.vec4()
            visits = float(0.0)
            p = faces.particles[end - 1]
            for corner in range(begin, end):
                q = faces.particles[corner]
                load = triangle_load(points[first + p], points[first + q], center, level, up)
                if p == particle:
                    total += corner_load(load, load.moments[0], load.areas[0])
                if q == particle:
                    total += corner_load(load, load.moments[1], load.areas[1])
                    visits += 1.0
                center_total += corner_load(load, load.moments[2], load.areas[2])
                p = q
            total += (visits / float(end - begin)) * center_total
    return total


@wp.func
def add_face_load(
    faces: FaceTable, points: wp.array[wp.vec3], face: wp.int32, level: float, up: wp.vec3, loads: wp.array[wp.vec4]
):
    """To each corner of a face, what `particle_load` would find there of it."""
    begin = faces.offsets[face]
    end = faces.offsets[face + 1]
    if not is_dry(faces, points, 0, begin, end, level, up):
        center = face_center(points, 0, faces.particles, begin, end)
        center_total = wp.vec4()
        p = faces.particles[end - 1]
        for corner in range(begin, end):
            q = faces.particles[corner]
            load = triangle_load(points[p], points[q], center, level, up)
            wp.atomic_add(loads, p, corner_load(load, load.moments[0], load.areas[0]))
            wp.atomic_add(loads, q, corner_load(load, load.moments[1], load.areas[1]))
            center_total += corner_load(load, load.moments[2], load.areas[2])
            p = q
        for corner in range(begin, end):
            wp.atomic_add(loads, faces.particles[corner], center_total / float(end - begin))


@wp.func
def water_level(water: WaterTable, world: wp.int32):
    """[m]"""
    return water.level[row_of_world(world, water.level.shape[0])]


@wp.func
def water_drag(density: float, drag: float, wet_area: float, velocity: wp.vec3, mass: float, step_seconds: float):
    """Force against the velocity [N]: 1/2 density drag A |v| v as it is on average over a step in which nothing else
    acts, 1/v growing evenly: a light particle in a dense liquid stops, and does not turn back."""
    resistance = 0.5 * density * drag * wet_area * wp.length(velocity)
    return -resistance / (1.0 + resistance * response(mass, step_seconds)) * velocity


@wp.func
def force_of_load(
    water: WaterTable,
    bodies: BodyTable,
    world: wp.int32,
    particle: wp.int32,
    load: wp.vec4,
    velocity: wp.vec3,
    step_seconds: float,
):
    """Hydrostatic pressure and drag on a particle [N], from its load."""
    gravity = bodies.gravity[row_of_world(world, bodies.gravity.shape[0])]
    density = water.density[row_of_world(world, water.density.shape[0])]
    drag = water.drag[row_of_world(world, water.drag.shape[0])]
    mass = particle_mass(bodies, world, particle)
    pressure = -density * gravity * wp.vec3(load[0], load[1], load[2])
    return pressure + water_drag(density, drag, load[3], velocity, mass, step_seconds)


@wp.func
def water_force(
    water: WaterTable,
    faces: FaceTable,
    bodies: BodyTable,
    points: Any,
    first: wp.int32,
    world: wp.int32,
    particle: wp.int32,
    velocity: wp.vec3,
    step_seconds: float,
):
    """Hydrostatic pressure and drag on a particle [N]; particle p stands at `points[first + p]`."""
    load = particle_load(faces, points, first, particle, water_level(water, world), bodies.up)
    return force_of_load(water, bodies, world, particle, load, velocity, step_seconds)


@wp.kernel(enable_backward=False)
def add_water_loads(
    # model
    water: WaterTable,
    faces: FaceTable,
    bodies: BodyTable,
    # state in
    points: wp.array2d[wp.vec3],
    # state out
    loads: wp.array2d[wp.vec4],
):
    """A thread a (world, face): its load to its corners."""
    world, face = wp.tid()
    add_face_load(faces, points[world], face, water_level(water, world), bodies.up, loads[world])


@wp.kernel(enable_backward=False)
def add_water_forces(
    # model
    water: WaterTable,
    bodies: BodyTable,
    step_seconds: float,
    # state in
    loads: wp.array2d[wp.vec4],
    velocities: wp.array2d[wp.vec3],
    # state out
    forces: wp.array2d[wp.vec3],
):
    """A thread a (world, particle): what the liquid does to it."""
    world, particle = wp.tid()
    forces[world, particle] += force_of_load(
        water, bodies, world, particle, loads[world, particle], velocities[world, particle], step_seconds
    )
