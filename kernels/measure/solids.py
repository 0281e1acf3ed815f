"""Volume, first and second moments of closed balloons as solids, exact for their polyhedra (Kim et al. 2006).

A face is the fan of triangles about its center, and each triangle spans a tetrahedron with a fixed apex, over which 1,
x and x x^T have integrals in closed form. In double precision, and in a fixed order: every run gives the same bits.
"""

import warp as wp

from balloon_warp.kernels.options import OPTIONS

wp.set_module_options(OPTIONS)


@wp.struct
class SolidSums:
    """Integrals over a balloon's inside, or a thread's part of it. Places are from one of the balloon's own points."""

    volume: wp.float64
    """Integral of 1 [m^3]"""
    first: wp.vec3d
    """Integral of x [m^4]"""
    second: wp.mat33d
    """Integral of x x^T [m^5]"""


@wp.func
def add_tetrahedron(sums: SolidSums, a: wp.vec3d, b: wp.vec3d, c: wp.vec3d):
    """Return the sums with the integrals over the tetrahedron of the origin and three points."""
    corners = a + b + c
    volume = wp.dot(a, wp.cross(b, c)) / wp.float64(6.0)
    products = wp.outer(a, a) + wp.outer(b, b) + wp.outer(c, c) + wp.outer(corners, corners)
    sums.volume += volume
    sums.first += (volume / wp.float64(4.0)) * corners
    sums.second += (volume / wp.float64(20.0)) * products
    return sums


@wp.func
def first_particle(
    balloon_faces: wp.array[wp.int32],
    face_offsets: wp.array[wp.int32],
    face_particles: wp.array[wp.int32],
    balloon: wp.int32,
):
    """Return the balloon's particle that its sums are taken about."""
    return face_particles[face_offsets[balloon_faces[balloon]]]


@wp.kernel(enable_backward=False)
def sum_solids(
    # model
    balloon_faces: wp.array[wp.int32],
    face_offsets: wp.array[wp.int32],
    face_particles: wp.array[wp.int32],
    # state in
    points: wp.array2d[wp.vec3],
    # out
    sums: wp.array3d[SolidSums],
):
    """Sum integrals over every n-th face of a balloon; a thread a (world, balloon, thread)."""
    world, balloon, thread = wp.tid()
    part = SolidSums()
    origin = wp.vec3d(points[world, first_particle(balloon_faces, face_offsets, face_particles, balloon)])
    for face in range(balloon_faces[balloon] + thread, balloon_faces[balloon + 1], sums.shape[2]):
        begin = face_offsets[face]
        end = face_offsets[face + 1]
        center = wp.vec3d()
        for corner in range(begin, end):
            center += wp.vec3d(points[world, face_particles[corner]]) - origin
        center /= wp.float64(end - begin)
        before = wp.vec3d(points[world, face_particles[end - 1]]) - origin
        for corner in range(begin, end):
            here = wp.vec3d(points[world, face_particles[corner]]) - origin
            part = add_tetrahedron(part, before, here, center)
            before = here
    sums[world, balloon, thread] = part


@wp.kernel(enable_backward=False)
def measure_solids(
    # model
    balloon_faces: wp.array[wp.int32],
    face_offsets: wp.array[wp.int32],
    face_particles: wp.array[wp.int32],
    # state in
    points: wp.array2d[wp.vec3],
    sums: wp.array3d[SolidSums],
    # out
    volumes: wp.array2d[wp.float64],
    centers: wp.array2d[wp.vec3d],
    inertias: wp.array2d[wp.mat33d],
):
    """Compute volume, center of mass, and inertia tensor about it at a density of 1; a thread a (world, balloon).

    A balloon without volume has its center at its first point, and no inertia.
    """
    world, balloon = wp.tid()
    total = SolidSums()
    for thread in range(sums.shape[2]):
        part = sums[world, balloon, thread]
        total.volume += part.volume
        total.first += part.first
        total.second += part.second
    center = wp.vec3d()
    inertia = wp.mat33d()
    if total.volume != wp.float64(0.0):
        center = total.first / total.volume
        spread = total.second - total.volume * wp.outer(center, center)
        inertia = wp.trace(spread) * wp.identity(n=3, dtype=wp.float64) - spread
    origin = points[world, first_particle(balloon_faces, face_offsets, face_particles, balloon)]
    volumes[world, balloon] = total.volume
    centers[world, balloon] = wp.vec3d(origin) + center
    inertias[world, balloon] = inertia
