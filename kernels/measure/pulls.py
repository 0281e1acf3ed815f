"""Force of each spring, each string and each law, of which a schedule only knows the sum."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.algebra import squared_length
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.loops.net_force import face_loop, held_string_pull, net_force_function, scalar_loops
from balloon_warp.kernels.loops.springs import pair_pull
from balloon_warp.kernels.memory import vector_at
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.params import params_functions
from balloon_warp.kernels.tables import Tables


@cache
def pull_kernel(measure: Any) -> Any:
    """Return the kernel that measures forces.

    Args:
        measure: the function that does so, one of those that are made below.
    """

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def measure_pulls(
        # model
        t: Tables,
        time: float,
        # state in
        points: wp.array2d[wp.vec3],
        velocities: wp.array2d[wp.vec3],
        # out
        pulls: wp.array3d[float],
    ):
        """Measure the forces of springs, strings and laws; a thread a (world, item)."""
        world, item = wp.tid()
        measure(t, world, item, points[world], velocities[world], time, pulls[world])

    return measure_pulls


@cache
def spring_measure(features: Features) -> Any:
    """Return the function that measures a spring."""
    pull_of_pair = pair_pull(features)

    @wp.func
    def measure_spring(
        t: Tables, world: wp.int32, spring: wp.int32, points: Any, velocities: Any, time: float, pulls: Any
    ):
        """Measure the tension of a spring, negative if it pushes [N]."""
        d, coefficient = pull_of_pair(t, world, spring, points, velocities, time)
        pulls[0, spring] = wp.sqrt(squared_length(d)) * coefficient

    return measure_spring


@cache
def string_measure(features: Features) -> Any:
    """Return the function that measures a string."""
    pull_of_held_string = held_string_pull(features)

    @wp.func
    def measure_string(
        t: Tables, world: wp.int32, held: wp.int32, points: Any, velocities: Any, time: float, pulls: Any
    ):
        """Measure the force of a string on its particle [N]."""
        pull = pull_of_held_string(t, world, held, points, velocities, time)
        pulls[0, t.strings.order[held][0]] = wp.length(pull)

    return measure_string


@cache
def law_measure(alones: tuple[Features, ...], number: int = 0) -> Any:
    """Return the function that measures the laws on a particle, one by one.

    Args:
        alones: the features with one law on particles, hinges or faces alone, or with membranes.
    """
    features = alones[0]
    alone = features._replace(pressures=False)
    _, read_params = params_functions(features.columns, features.balloons)
    loops = scalar_loops(alone, vector_at)
    net_force, load_of_particle = net_force_function(alone, loops), loops.water_load
    push_of_faces = face_loop(alone, vector_at, vector_at) if alone.has("face") else None
    others = law_measure(alones[1:], number + 1) if len(alones) > 1 else None

    @wp.func
    def measure_laws(
        t: Tables, world: wp.int32, particle: wp.int32, points: Any, velocities: Any, time: float, pulls: Any
    ):
        """Measure the force of each law [N]."""
        params = read_params(t, world, particle)
        point = points[particle]
        load = wp.vec4()
        if wp.static(alone.in_water):
            load = load_of_particle(t, points, params)
        force, _area, _facing = net_force(
            t, points, velocities, params, particle, point, velocities[particle], load, time
        )
        if wp.static(push_of_faces is not None):
            force += push_of_faces(t, points, velocities, world, particle, time)
        pulls[number, particle] = wp.length(force)
        if wp.static(others is not None):
            others(t, world, particle, points, velocities, time, pulls)

    return measure_laws
