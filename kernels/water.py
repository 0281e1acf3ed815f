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


@wp.func
def water_load(faces: FaceTable, points: Any, first: wp.int32, particle: wp.int32, level: float, up: wp.vec3):
    """A particle's share of depth times area vector over the wetted faces [m^3], and of their wetted area [m^2].

    Particle p stands at `points[first + p]`.
    """
    load = wp.vec3()
    wet_area = float(0.0)
    for incidence in range(faces.particle_offsets[particle], faces.particle_offsets[particle + 1]):
        face = faces.around_particles[incidence]
        begin = faces.offsets[face]
        end = faces.offsets[face + 1]
        center = face_center(points, first, faces.particles, begin, end)
        center_load = wp.vec3()
        center_area = float(0.0)
        visits = float(0.0)
        p = faces.particles[end - 1]
        for corner in range(begin, end):
            q = faces.particles[corner]
            a = points[first + p]
            b = points[first + q]
            depths = wp.vec3(level - wp.dot(a, up), level - wp.dot(b, up), level - wp.dot(center, up))
            if wp.max(depths) > 0.0:
                moments, areas = wet_shares(depths)
                area_vector = 0.5 * wp.cross(a - center, b - center)
                area = wp.length(area_vector)
                at_p = wp.where(p == particle, 1.0, 0.0)
                at_q = wp.where(q == particle, 1.0, 0.0)
                load += (at_p * moments[0] + at_q * moments[1]) * area_vector
                wet_area += (at_p * areas[0] + at_q * areas[1]) * area
                center_load += moments[2] * area_vector
                center_area += areas[2] * area
            visits += wp.where(q == particle, 1.0, 0.0)
            p = q
        load += (visits / float(end - begin)) * center_load
        wet_area += (visits / float(end - begin)) * center_area
    return load, wet_area


@wp.func
def water_drag(density: float, drag: float, wet_area: float, velocity: wp.vec3, mass: float, step_seconds: float):
    """Force against the velocity [N]: 1/2 density drag A |v| v as it is on average over a step in which nothing else
    acts, 1/v growing evenly: a light particle in a dense liquid stops, and does not turn back."""
    resistance = 0.5 * density * drag * wet_area * wp.length(velocity)
    return -resistance / (1.0 + resistance * response(mass, step_seconds)) * velocity


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
    gravity = bodies.gravity[row_of_world(world, bodies.gravity.shape[0])]
    density = water.density[row_of_world(world, water.density.shape[0])]
    drag = water.drag[row_of_world(world, water.drag.shape[0])]
    level = water.level[row_of_world(world, water.level.shape[0])]
    load, wet_area = water_load(faces, points, first, particle, level, bodies.up)
    mass = particle_mass(bodies, world, particle)
    return -density * gravity * load + water_drag(density, drag, wet_area, velocity, mass, step_seconds)


@wp.kernel(enable_backward=False)
def add_water_forces(
    # model
    water: WaterTable,
    faces: FaceTable,
    bodies: BodyTable,
    step_seconds: float,
    # state in
    points: wp.array2d[wp.vec3],
    velocities: wp.array2d[wp.vec3],
    # state out
    forces: wp.array2d[wp.vec3],
):
    """A thread a (world, particle): what the liquid does to it."""
    world, particle = wp.tid()
    velocity = velocities[world, particle]
    forces[world, particle] += water_force(
        water, faces, bodies, points[world], 0, world, particle, velocity, step_seconds
    )
