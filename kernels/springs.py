"""Springs: structural, shear and flexion alike, and strings, which pull but do not push."""

import warp as wp


@wp.func_native(
    """
#if defined(__CUDA_ARCH__)
    return rsqrtf(x);
#else
    return 1.0f / sqrtf(x);
#endif
    """,
    adj_snippet="adj_x -= 0.5f * adj_ret / (x * sqrtf(x));",
)
def inverse_root(x: float) -> float:
    """1 / sqrt(x); one instruction of a GPU, where the division of a root takes two even with fast math."""
    ...


@wp.func
def squared_length(d: wp.vec3):
    """|d|^2, and a little more, so that its root can be divided by."""
    return d[0] * d[0] + (d[1] * d[1] + (d[2] * d[2] + 1.0e-20))


@wp.func
def spring_coefficient(squared_length: float, stiffness: float, stiffness_times_length: float):
    """Force per unit displacement of a Hookean spring [N/m]: F = coefficient * d, d the vector to the other end.

    k (|d| - L) d/|d| written as (k - k L/|d|) d. Coincident ends have d = 0 and a finite coefficient: no force, no NaN.

    Args:
        squared_length: of d, not quite 0: see the function of that name.
    """
    return stiffness - stiffness_times_length * inverse_root(squared_length)


@wp.func
def rubber_coefficient(
    squared_length: float,
    opening: float,
    stiffness: float,
    stiffness_times_length: float,
    viscosity: float,
    yield_stretch: float,
):
    """Force per unit displacement [N/m] of a spring that is viscous too, and overextended from some stretch on: then it
    pulls no more (Tarantino 1996).

    Args:
        opening: d . d' [m^2/s], so that the spring lengthens by opening / |d| each second.
        viscosity: damping constant over spring constant [s].
        yield_stretch: length over rest length from which on there is no force.
    """
    coefficient = spring_coefficient(squared_length, stiffness, stiffness_times_length)
    if coefficient > stiffness * (1.0 - 1.0 / yield_stretch):  # coefficient / stiffness is 1 - L/|d|
        return 0.0
    return coefficient + viscosity * stiffness * opening / squared_length


AT_LIMIT = wp.constant(0.999)
"""of its longest, from which on a spring counts as at its limit: correction leaves it there but for rounding"""


@wp.func
def stretch_without_pull(yield_stretch: float, limit: float, yields_at_limit: bool):
    """Length over rest length from which on a spring does not pull, which may be where its length is corrected to."""
    if yields_at_limit:
        return wp.min(yield_stretch, AT_LIMIT * (1.0 + limit))
    return yield_stretch


@wp.func
def string_coefficient(squared_length: float, stiffness: float, length: float):
    """Force per unit displacement of a string [N/m]: a spring while taut, nothing while slack."""
    return wp.max(spring_coefficient(squared_length, stiffness, stiffness * length), 0.0)


@wp.kernel
def add_spring_forces(
    # model
    spring_particles: wp.array[wp.vec2i],
    spring_kind: wp.array[wp.int32],
    spring_rest_length: wp.array[float],
    spring_stiffness_scale: wp.array[float],
    particle_balloon: wp.array[wp.int32],
    stiffness: wp.array3d[float],
    # state in
    points: wp.array2d[wp.vec3],
    # state out
    forces: wp.array2d[wp.vec3],
):
    """A thread a (world, spring): equal and opposite forces on its two particles."""
    world, spring = wp.tid()
    ends = spring_particles[spring]
    p, q = ends[0], ends[1]
    k = stiffness[world % stiffness.shape[0], particle_balloon[p], spring_kind[spring]] * spring_stiffness_scale[spring]
    d = points[world, q] - points[world, p]
    force = spring_coefficient(squared_length(d), k, k * spring_rest_length[spring]) * d
    wp.atomic_add(forces, world, p, force)
    wp.atomic_sub(forces, world, q, force)


@wp.kernel
def add_rubber_forces(
    # model
    spring_particles: wp.array[wp.vec2i],
    spring_kind: wp.array[wp.int32],
    spring_rest_length: wp.array[float],
    spring_stiffness_scale: wp.array[float],
    particle_balloon: wp.array[wp.int32],
    stiffness: wp.array3d[float],
    viscosity: wp.array2d[float],
    yield_stretch: wp.array2d[float],
    correction_limit: wp.array[float],
    yields_at_limit: bool,
    # state in
    points: wp.array2d[wp.vec3],
    velocities: wp.array2d[wp.vec3],
    # state out
    forces: wp.array2d[wp.vec3],
):
    """A thread a (world, spring): `add_spring_forces` for springs that are viscous or can be overextended."""
    world, spring = wp.tid()
    ends = spring_particles[spring]
    p, q = ends[0], ends[1]
    balloon = particle_balloon[p]
    k = stiffness[world % stiffness.shape[0], balloon, spring_kind[spring]] * spring_stiffness_scale[spring]
    d = points[world, q] - points[world, p]
    coefficient = rubber_coefficient(
        squared_length(d),
        wp.dot(velocities[world, q] - velocities[world, p], d),
        k,
        k * spring_rest_length[spring],
        viscosity[world % viscosity.shape[0], balloon],
        stretch_without_pull(
            yield_stretch[world % yield_stretch.shape[0], balloon],
            correction_limit[world % correction_limit.shape[0]],
            yields_at_limit,
        ),
    )
    wp.atomic_add(forces, world, p, coefficient * d)
    wp.atomic_sub(forces, world, q, coefficient * d)


@wp.kernel
def add_string_forces(
    # model
    string_particle: wp.array[wp.int32],
    string_anchor: wp.array2d[wp.vec3],
    string_length: wp.array2d[float],
    string_stiffness: wp.array2d[float],
    # state in
    points: wp.array2d[wp.vec3],
    # state out
    forces: wp.array2d[wp.vec3],
):
    """A thread a (world, string): the pull of a taut string on its particle."""
    world, string = wp.tid()
    p = string_particle[string]
    d = string_anchor[world % string_anchor.shape[0], string] - points[world, p]
    k = string_stiffness[world % string_stiffness.shape[0], string]
    length = string_length[world % string_length.shape[0], string]
    wp.atomic_add(forces, world, p, string_coefficient(squared_length(d), k, length) * d)
