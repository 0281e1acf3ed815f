"""Fast simulation of mass-spring systems (Liu et al. 2013): backward Euler by local and global steps.

A substep h seeks the displacements u that minimize

    g(u) = sum_p (m + h c) |u - w|^2 / (2 h^2) + E(x + u)

where E is the energy of springs and strings, c the damping, and w the displacement that there would be without them.
The local step projects each spring on its rest length: its vector d becomes L d/|d|. The global step then solves the
linear system (M + h C + h^2 L) u = (M + h C) w + h^2 (pull of the projections), whose matrix A never changes. Here it
is solved for the increment, which float32 resolves better,

    A du = (m + h c) (w - u) + h^2 F(x + u)

since k (L d/|d| - d) is the force of a spring: the local step is Hooke's law, at the particles of the last iteration. A
slack string has itself as projection, so it has no force either. Each such iteration lowers g, whatever h is. Their
number, and the means to reduce it, are in `settling`.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.compose import sum_of_laws
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.body import DAMPING
from balloon_warp.kernels.laws.law import RESULT
from balloon_warp.kernels.loops.net_force import outer_force, string_loop
from balloon_warp.kernels.loops.springs import spring_loop
from balloon_warp.kernels.memory import vector_at
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.params import Clock, params_functions, time_in_frame_of, time_of
from balloon_warp.kernels.solvers.settling import Settling
from balloon_warp.kernels.tables import Tables, WorldState

wp.set_module_options(OPTIONS)


@cache
def inertia_function(features: Features) -> Any:
    """Return the function for the effective mass of a particle in a step h, m + h c [kg], damping included.

    It is 0 for a fixed particle.
    """
    column = features.columns.places["damping"]

    @wp.func
    def inertia(params: Any, step_seconds: float):
        return params.mass + step_seconds * params.share * params.n[column]

    return inertia


@cache
def foreseeing_kernel(features: Features) -> Any:
    """Return the kernel that predicts displacements."""
    _, read_params = params_functions(features.columns, features.balloons)
    outer = tuple(law for law in features.of_kind("particle") if law is not DAMPING)
    particle_laws = sum_of_laws("particle", RESULT["particle"], outer, features.columns, features.air)
    inertia = inertia_function(features)

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def foresee_displacements(
        # model
        t: Tables,
        clock: Clock,
        substep: wp.int32,
        # state in
        state: WorldState,
        inflations: wp.array2d[wp.vec3],
        # out
        settling: Settling,
        free_displacements: wp.array2d[wp.vec3],
        displacements: wp.array2d[wp.vec3],
        reached: wp.array2d[wp.vec3],
        trial_points: wp.array2d[wp.vec3],
    ):
        """Predict the displacements w, where the iterations begin; a thread a (world, particle)."""
        world, particle = wp.tid()
        params = read_params(t, world, particle)
        point = state.points[world, particle]
        free = wp.vec3()
        if params.mass > 0.0:
            velocity = state.velocities[world, particle]
            time = time_of(t, state.frame, time_in_frame_of(clock, substep))
            force = inflations[world, particle] + particle_laws(
                point, velocity, params.mass, params.share, wp.vec3(), wp.vec4(), t.up, t.step_seconds, time, params.n
            )
            if wp.static(features.driven):
                force += outer_force(t.outer, world, particle)
            impulse = params.mass * velocity + t.step_seconds * force
            free = (t.step_seconds / inertia(params, t.step_seconds)) * impulse
        free_displacements[world, particle] = free
        displacements[world, particle] = free
        reached[world, particle] = free
        trial_points[world, particle] = point + free
        if particle == 0:
            settling.iterations[world] = 0
            settling.gathered[world] = 0
            settling.going[world] = 1
            settling.any_going[0] = 1

    return foresee_displacements


@cache
def local_step_kernel(features: Features) -> Any:
    """Return the kernel of the local step."""
    _, read_params = params_functions(features.columns, features.balloons)
    pull_of_springs = spring_loop(features, vector_at)
    pull_of_strings = string_loop(features)
    inertia = inertia_function(features)

    @wp.kernel(module="unique", enable_backward=False, module_options={**OPTIONS, "fast_math": True})
    def find_residuals(
        # model
        t: Tables,
        # in
        free_displacements: wp.array2d[wp.vec3],
        displacements: wp.array2d[wp.vec3],
        trial_points: wp.array2d[wp.vec3],
        # out
        settling: Settling,
        residuals: wp.array2d[wp.vec3],
    ):
        """Compute the residuals, minus h^2 times the slope of g [kg m], in worlds that go on.

        A thread a (world, particle).
        """
        world, particle = wp.tid()
        if world == 0 and particle == 0:
            settling.any_going[0] = 0  # until one says so
        if settling.going[world] == 0:
            return
        params = read_params(t, world, particle)
        residual = wp.vec3()
        if params.share > 0.0:
            point = trial_points[world, particle]
            displacement = displacements[world, particle]
            # No law here looks at velocities or at the time.
            pull = pull_of_springs(
                t, trial_points[world], displacements[world], params, params.number, point, displacement, 0.0
            )
            if wp.static(features.has("string")):
                pull += pull_of_strings(t.strings, world, particle, point, displacement, params.n, t.step_seconds, 0.0)
            lag = free_displacements[world, particle] - displacement
            residual = inertia(params, t.step_seconds) * lag + t.step_seconds * t.step_seconds * pull
        residuals[world, particle] = residual

    return find_residuals


@wp.kernel(enable_backward=False)
def take_displacements(
    # model
    step_seconds: float,
    # in
    displacements: wp.array2d[wp.vec3],
    # state in and out
    points: wp.array2d[wp.vec3],
    velocities: wp.array2d[wp.vec3],
):
    """Apply the displacements, before contacts; a thread a (world, particle)."""
    world, particle = wp.tid()
    displacement = displacements[world, particle]
    points[world, particle] = points[world, particle] + displacement
    velocities[world, particle] = displacement / step_seconds
