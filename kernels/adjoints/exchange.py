"""Adjoint of the exchange of momentum between spheres and particles, a block a world.

Spheres exchange it one after the other. So the results of each, and the places of particles before it, are found again,
and then run through from the last to the first. The change of a sphere's velocity solves A D = b; with the derivatives
d by D, those by A and b follow from l = A^-1 d: A is symmetric.
"""

from collections.abc import Sequence
from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoints.answers import Answer, Common, Load, work_of_particle, work_of_sphere
from balloon_warp.kernels.adjoints.exchange_tables import ExchangeBars, Exchanges, Met, Sums, put_sums, sums_of
from balloon_warp.kernels.adjoints.sphere_bars import add_by_friction, add_by_sphere, bar_of_course, put_bar_of_course
from balloon_warp.kernels.adjoints.spheres import LoggedSpheres
from balloon_warp.kernels.contact.near import PARTICLES_A_MARK
from balloon_warp.kernels.contact.spheres import marked_functions, settling_function
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.impulse import (
    OVERLAPPING,
    PRESSED,
    common_inertia,
    ground_beside,
    is_met,
    is_pressed,
    mass_in,
    meet_sphere,
    push_of_ground,
    shift_of_body,
    sinking_of_sphere,
)
from balloon_warp.kernels.loops.fixtures import GROUND, friction_on, number_of_sphere
from balloon_warp.kernels.loops.net_force import inertia_function
from balloon_warp.kernels.loops.spheres import Ball, ball_function, course_at
from balloon_warp.kernels.memory import put_vector, vector_at
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.params import params_functions
from balloon_warp.kernels.phase import Adjoint, Look, Phase
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.warps import sum_over_block
from balloon_warp.kernels.working import Working


def exchange_backwards(phase: Phase, features: Features, look: Look) -> Sequence[Adjoint]:
    """Return no adjoint of the exchange: kernels of its own run it backwards."""
    return ()


@cache
def exchange_again_kernel(features: Features) -> Any:
    """Return the kernel that exchanges momentum again, and keeps the results of each sphere."""
    ball_at = ball_function(features)
    settle = settling_function(features, vector_at, put_vector, sum_over_block)
    _, answer_at_mark, _ = marked_functions(features, vector_at, put_vector)

    @wp.func
    def copy_mark(exchanges: Exchanges, world: wp.int32, sphere: wp.int32, mark: wp.int32, count: wp.int32):
        """Bring a mark's particles from before a sphere to after it."""
        for particle in range(mark * PARTICLES_A_MARK, wp.min((mark + 1) * PARTICLES_A_MARK, count)):
            exchanges.points[sphere + 1, world, particle] = exchanges.points[sphere, world, particle]
            exchanges.velocities[sphere + 1, world, particle] = exchanges.velocities[sphere, world, particle]

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def exchange_again(t: Tables, working: Working, spheres: LoggedSpheres, exchanges: Exchanges):
        """Let the spheres of a world exchange momentum; a block a world."""
        world, thread = wp.tid()
        marks = working.near.shape[1] - 1
        if working.near[world, marks] > 0:
            for sphere in range(t.spheres.numbers.shape[1]):
                for mark in range(thread, marks, wp.block_dim()):
                    if working.near[world, mark] > 0:
                        copy_mark(exchanges, world, sphere, mark, t.particles.balloon.shape[0])
                ball = ball_at(t, spheres, world, sphere)
                points = exchanges.points[sphere + 1]
                velocities = exchanges.velocities[sphere + 1]
                press, last, change = settle(t, working, world, thread, ball, points[world], velocities[world])
                shift = shift_of_body(press, ball.mass, t.up)
                part = wp.spatial_vector()
                if is_met(press):
                    for mark in range(thread, marks, wp.block_dim()):
                        if working.near[world, mark] > 0:
                            part += answer_at_mark(
                                t, working, world, mark, sphere, ball, press, last, change, shift, points[world],
                                velocities[world],
                            )  # fmt: skip
                rub = sum_over_block(part)
                if thread == 0:
                    met = Met()
                    met.press = press
                    met.last = last
                    met.change = change
                    met.shift = shift
                    met.rub = rub
                    exchanges.met[world, sphere] = met

    return exchange_again


@cache
def particle_adjoint(features: Features) -> Any:
    """Return the function that runs a particle's answer to a sphere backwards."""
    _, read_params = params_functions(features.columns, features.balloons)
    inertia = inertia_function(features)

    @wp.func
    def answer_backwards(
        t: Tables, working: Working, spheres: LoggedSpheres, exchanges: Exchanges, bars: ExchangeBars, world: wp.int32,
        sphere: wp.int32, particle: wp.int32, ball: Ball, answer: Answer, by_pressed: float, writes: bool,
    ):  # fmt: skip
        """Return a particle's derivatives by the quantities common to all, and by the sphere.

        Args:
            answer: with the derivatives by friction on all, and by the push.
            by_pressed: derivative by the mass of all that is pressed.
            writes: whether the particle's own derivatives are written.
        """
        sums = Sums()
        params = read_params(t, world, particle)
        if params.share > 0.0:
            met = exchanges.met[world, sphere]
            point = exchanges.points[sphere, world, particle]
            velocity = exchanges.velocities[sphere, world, particle]
            way = t.step_seconds * (velocity - ball.velocity)
            outward, excess, out = meet_sphere(point - ball.center - way, way, ball.radius, t.up, t.step_seconds)
            answer.is_pressed = is_pressed(outward, excess, met.last)
            answer.overlaps = out > 0.0
            if answer.is_pressed or answer.overlaps:
                answer.place = bars.points[world, particle]
                answer.velocity = bars.velocities[world, particle]
                if wp.static(features.spheres_rub):
                    answer.friction = friction_on(t, world, params.balloon, number_of_sphere(t, sphere))
                common = Common()
                common.change = met.change
                common.shift = met.shift
                common.pressed = mass_in(met.press, PRESSED)
                mass = inertia(working, params)
                by_point, by_velocity, by_ball, by_radius, by_heavy, by_mass, by_common, by_answer, _up = wp.grad(
                    work_of_particle
                )(
                    point, velocity, course_at(spheres, world, sphere), ball.radius, ball.mass, mass, common, answer,
                    t.up,
                )  # fmt: skip
                sums = sums_of(by_common, by_ball, by_radius, by_heavy)
                if writes:
                    bars.points[world, particle] = answer.place + by_point
                    bars.velocities[world, particle] = answer.velocity + by_velocity
                    if answer.is_pressed:
                        by_mass += by_pressed
                    bars.masses[world, particle] = bars.masses[world, particle] + by_mass
                    if wp.static(features.spheres_rub):
                        by_friction = bars.spheres.rubs[world, particle, sphere] + by_answer.friction
                        bars.spheres.rubs[world, particle, sphere] = by_friction
        return sums

    return answer_backwards


@cache
def sphere_adjoint(features: Features) -> Any:
    """Return the function that runs the exchange of one sphere backwards, by all threads of a block."""
    ball_at, answer_backwards = ball_function(features), particle_adjoint(features)

    @wp.func
    def sum_of_answers(
        t: Tables, working: Working, spheres: LoggedSpheres, exchanges: Exchanges, bars: ExchangeBars, world: wp.int32,
        sphere: wp.int32, thread: wp.int32, ball: Ball, answer: Answer, by_pressed: float, writes: bool,
    ):  # fmt: skip
        part = Sums()
        count = t.particles.balloon.shape[0]
        for mark in range(thread, working.near.shape[1] - 1, wp.block_dim()):
            if working.near[world, mark] > 0:
                for particle in range(mark * PARTICLES_A_MARK, wp.min((mark + 1) * PARTICLES_A_MARK, count)):
                    part += answer_backwards(
                        t, working, spheres, exchanges, bars, world, sphere, particle, ball, answer, by_pressed, writes
                    )
        return sum_over_block(part)

    @wp.func
    def exchange_back(
        t: Tables, working: Working, spheres: LoggedSpheres, exchanges: Exchanges, bars: ExchangeBars, world: wp.int32,
        sphere: wp.int32, thread: wp.int32, height: float,
    ):  # fmt: skip
        """Run the exchange of a sphere backwards, and return the derivative by the ground's height."""
        met = exchanges.met[world, sphere]
        if not is_met(met.press):
            return 0.0
        ball = ball_at(t, spheres, world, sphere)
        bar = bar_of_course(bars.spheres, world, sphere)
        ground = ground_beside(met.press, ball.mass, t.up, ball.sinking, met.last)
        load = Load()
        friction = float(0.0)
        if wp.static(features.spheres_rub):
            load.rub = wp.spatial_top(met.rub)
            load.torque = wp.spatial_bottom(met.rub)
            if is_pressed(-t.up, ball.sinking, met.change):
                load.push = push_of_ground(met.press, ball.mass, t.up, met.change)
                friction = ball.ground_friction
        common = Common()
        common.change = met.change
        common.shift = met.shift
        by_course, by_radius, by_mass, by_common, by_load, by_friction, _step, _up, _bar = wp.grad(work_of_sphere)(
            course_at(spheres, world, sphere), ball.radius, ball.mass, common, load, friction, t.step_seconds, t.up, bar
        )
        by_ground = wp.where(load.push > 0.0, by_load.push, 0.0)
        answer = Answer()
        answer.step = t.step_seconds
        answer.rub = by_load.rub
        answer.torque = by_load.torque
        answer.by_push = by_ground * t.up
        found = sum_of_answers(
            t, working, spheres, exchanges, bars, world, sphere, thread, ball, answer, 0.0, False
        )  # fmt: skip
        by_change = by_common.change + (ball.mass * by_ground) * t.up + wp.vec3(found[0], found[1], found[2])
        by_shift = by_common.shift + wp.vec3(found[3], found[4], found[5])
        inertia = common_inertia(met.press, PRESSED, ball.mass, ground, t.up)
        solved = wp.inverse(inertia) * wp.vec3d(by_change)
        inertia = common_inertia(met.press, OVERLAPPING, ball.mass, wp.float64(0.0), t.up)
        answer.by_push -= wp.vec3(solved)
        answer.by_overlap = -wp.vec3(wp.inverse(inertia) * wp.vec3d(by_shift))
        taken = sum_of_answers(
            t, working, spheres, exchanges, bars, world, sphere, thread, ball, answer, found[6], True
        )  # fmt: skip
        by_sinking = float(ground * wp.dot(wp.vec3d(t.up), solved))
        by_place, by_velocity, of_radius, _u, by_height, _s = wp.grad(sinking_of_sphere)(
            ball.center, ball.velocity, ball.radius, t.up, height, t.step_seconds
        )
        by_mass += wp.dot(answer.by_push, met.change) + wp.dot(answer.by_overlap, met.shift)
        if thread == 0:
            by_course = put_sums(by_course, taken)
            by_course.position += by_sinking * by_place
            by_course.velocity += by_sinking * by_velocity
            put_bar_of_course(bars.spheres, world, sphere, by_course)
            by_radius += taken[16] + by_sinking * of_radius
            add_by_sphere(bars.spheres, world, sphere, by_mass + taken[17], by_radius)
            add_by_friction(bars.spheres, world, number_of_sphere(t, sphere), GROUND, by_friction)
        return by_sinking * by_height

    return exchange_back
