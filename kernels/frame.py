"""What every schedule needs around its frames: the start, the refreshed inflation, a look at the result.

One module without adjoints, since every module and every adjoint adds to the time that a user waits for a first frame.
"""

import warp as wp

from balloon_warp.kernels import inflation
from balloon_warp.kernels.gas import inflation_of_kind
from balloon_warp.kernels.health import HealthTable, look_at_particle, look_at_sphere
from balloon_warp.kernels.tables import AirTable, BodyTable


def _without_adjoint(kernel: wp.Kernel) -> wp.Kernel:
    """A kernel that `scatter` differentiates, for those who do not."""
    return wp.kernel(kernel.func, enable_backward=False, module=wp.get_module(__name__))


ramp_inflation = _without_adjoint(inflation.ramp_inflation)
measure_faces = _without_adjoint(inflation.measure_faces)
aim_inflation = _without_adjoint(inflation.aim_inflation)


@wp.kernel(enable_backward=False)
def place_balloons(
    # model
    points: wp.array[wp.vec3d],
    shifts: wp.array2d[wp.vec3d],
    particle_balloon: wp.array[wp.int32],
    # out
    every: wp.array2d[wp.vec3],
):
    """A thread a (world, particle): its place. In double precision, so that it is what the host would place there."""
    world, particle = wp.tid()
    every[world, particle] = wp.vec3(points[particle] + shifts[world % shifts.shape[0], particle_balloon[particle]])


@wp.kernel(enable_backward=False)
def add_inflation_forces(
    # model
    bodies: BodyTable,
    air: AirTable,
    # state in
    points: wp.array2d[wp.vec3],
    inflation_aims: wp.array2d[wp.vec3],
    inflation_ramp: wp.array2d[wp.vec2],
    inflation_loads: wp.array2d[wp.vec2],
    # state out
    forces: wp.array2d[wp.vec3],
):
    """A thread a (world, particle): the force of its balloon's inflation at the start of a frame."""
    world, particle = wp.tid()
    balloon = bodies.balloon[particle]
    forces[world, particle] += inflation_of_kind(
        air.kind[balloon],
        inflation_ramp[world, balloon][0],
        inflation_loads[world, balloon],
        wp.dot(points[world, particle], bodies.up),
        inflation_aims[world, particle],
    )


@wp.kernel(enable_backward=False)
def end_frame(
    # model
    bodies: BodyTable,
    health: HealthTable,
    lanes: wp.int32,
    frames: wp.int32,
    # state in
    points: wp.array2d[wp.vec3],
    sphere_positions: wp.array2d[wp.vec3],
    # state out
    frame: wp.array[wp.int32],
    first_bad: wp.array[wp.int32],
):
    """A thread a (world, lane), which takes each so-manyth particle and sphere: the look at what a frame wrote. One of
    all counts the frames that have passed."""
    world, lane = wp.tid()
    row = points[world]
    for particle in range(lane, points.shape[1], lanes):
        look_at_particle(bodies, health, first_bad, world, particle, row[particle], row, 0)
    for sphere in range(lane, sphere_positions.shape[1], lanes):
        look_at_sphere(health, first_bad, world, points.shape[1], sphere, sphere_positions[world, sphere])
    if world == 0 and lane == 0:
        frame[0] = frame[0] + frames
