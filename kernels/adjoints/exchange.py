"""Adjoint of the exchange of momentum between spheres and particles, a block a world.

Warp derives the answers of a particle and of a sphere. Frozen is which particles a sphere presses, which overlap it,
and whether it is pressed to the ground. Each function returns where something is then, and how fast, times the
derivatives by that.

Spheres exchange it one after the other. So the results of each, and the places of particles before it, are found again,
and then run through from the last to the first. The change of a sphere's velocity solves A D = b; with the derivatives
d by D, those by A and b follow from l = A^-1 d: A is symmetric.
"""

from collections.abc import Sequence
from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels import OPTIONS
from balloon_warp.kernels.adjoints.rolling import motion_pairing
from balloon_warp.kernels.adjoints.solids import ground_columns, solid_contact_adjoints
from balloon_warp.kernels.adjoints.spheres import (
    BarsOfSpheres,
    LoggedSpheres,
    add_by_friction,
    add_by_sphere,
    bar_of_motion,
    put_bar_of_motion,
)
from balloon_warp.kernels.adjoints.sums import Bars, numbers_adder
from balloon_warp.kernels.compose import numbers_type, params_functions
from balloon_warp.kernels.contact.spheres import PARTICLES_A_MARK, marked_functions, settling_function
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.contact import (
    OVERLAPPING,
    PRESSED,
    Press,
    common_inertia,
    excess_speed,
    gain_of_particle,
    ground_beside,
    inverse_mass_of_ball,
    is_met,
    is_pressed,
    mass_in,
    meet_sphere,
    outward_direction,
    push_of_ground,
    rubbed,
    separation,
    shift_of_body,
    sinking_of_sphere,
    spin_by,
)
from balloon_warp.kernels.laws.rigid import rub_on
from balloon_warp.kernels.loops.contact import around_function
from balloon_warp.kernels.loops.fixtures import GROUND, friction_on, number_of_sphere
from balloon_warp.kernels.loops.net_force import inertia_function
from balloon_warp.kernels.loops.spheres import Ball, MotionState, ball_function, motion_at
from balloon_warp.kernels.memory import put_vector, vector_at
from balloon_warp.kernels.phase import Access, Adjoint, Phase
from balloon_warp.kernels.tables import Tables, row_of_world
from balloon_warp.kernels.warps import sum_over_block
from balloon_warp.kernels.working import Working


@wp.struct
class Common:
    """Sums over a sphere and all particles that it presses."""

    change: wp.vec3  # of the sphere's velocity
    shift: wp.vec3  # out of overlaps
    pressed: float  # mass of the particles that it presses [kg]


@wp.struct
class Response:
    """Constants of a particle's response, and derivatives by it."""

    step: float  # [s]
    friction: float
    is_pressed: bool
    overlaps: bool
    place: wp.vec3  # derivatives by where the particle is, how fast, and by friction on all and its torque
    velocity: wp.vec3
    rub: wp.vec3
    torque: wp.vec3
    by_push: wp.vec3  # derivatives by its momentum along the normal, and by its mass times how far it is moved
    by_overlap: wp.vec3


@wp.func
def particle_pairing(
    point: wp.vec3, velocity: wp.vec3, ball: MotionState, radius: float, heavy: float, mass: float, common: Common,
    terms: Response, up: wp.vec3,
):  # fmt: skip
    """Return a particle's gains beside a sphere, see `loops.spheres`, times their bars.

    Args:
        ball: course of the sphere, before it answers.
        heavy: its mass [kg].
        mass: of the particle, with its part of the gas [kg].
    """
    displacement = terms.step * (velocity - ball.velocity)
    arm = point - ball.position - displacement
    outward = outward_direction(arm, wp.vec3(), up)
    gap = wp.dot(arm, outward) - radius
    pairing = float(0.0)
    if terms.is_pressed:
        excess = excess_speed(gap, -wp.dot(displacement, outward) / terms.step, terms.step)
        gain = gain_of_particle(outward, excess, common.change)
        beside = velocity + gain - ball.velocity - common.change - wp.cross(ball.spin, arm)
        share = 1.0 / (1.0 + common.pressed * inverse_mass_of_ball(heavy, radius, arm))
        rub = rub_on(beside, mass * gain, mass, share, terms.friction)
        moved = gain + rub / mass
        pairing += wp.dot(moved, terms.velocity + terms.step * terms.place) + mass * wp.dot(gain, terms.by_push)
        pairing += wp.dot(rub, terms.rub) + wp.dot(wp.cross(arm, rub), terms.torque)
    if terms.overlaps:
        aside = gain_of_particle(outward, separation(gap, terms.step), common.shift)
        pairing += wp.dot(aside, terms.place) + mass * wp.dot(aside, terms.by_overlap)
    return pairing


@wp.struct
class Load:
    """Friction on a sphere by all particles, and the push of the ground."""

    rub: wp.vec3  # friction on all of them [N s]
    torque: wp.vec3  # of it about the center [N m s]
    push: float  # of the ground [N s]


@wp.func
def sphere_pairing(
    ball: MotionState, radius: float, heavy: float, common: Common, load: Load, ground_friction: float, step: float,
    up: wp.vec3, bar: MotionState,
):  # fmt: skip
    """Return a sphere's course once it has answered, see `loops.spheres`, times its bars."""
    gain = -load.rub / heavy
    spin = ball.spin - spin_by(heavy, radius, load.torque)
    going = ball.velocity + common.change + gain
    braked, more = rubbed(going, spin, wp.vec3(), up, load.push / heavy, radius, ground_friction)
    place = ball.position + step * (common.change + gain + braked) + common.shift
    return motion_pairing(place, going + braked, spin + more, bar)


Sums = wp.types.vector(length=18, dtype=wp.float32)
"""Sums over particles of the derivatives by the sphere's change of velocity, its shift, and the mass that it presses;
by its place, velocity, spin, radius and mass"""


@wp.struct
class ExchangeResult:
    """Result of the exchange of a sphere with the particles that it meets."""

    press: Press
    last: wp.vec3  # change of the sphere's velocity before it was settled, which says who is pressed
    change: wp.vec3
    shift: wp.vec3
    rub: wp.spatial_vector  # friction on all particles [N s], and its torque [N m s]


@wp.struct
class Exchanges:
    """Exchanges of all worlds in a substep, one sphere after the other."""

    points: wp.array3d[wp.vec3]
    """Places before each sphere, and after the last, of particles near any, shape (S + 1, W, P)"""
    velocities: wp.array3d[wp.vec3]
    met: wp.array2d[ExchangeResult]
    """Findings of each sphere, shape (W, S)"""


@wp.struct
class ExchangeBars:
    """Derivatives by spheres and particles that exchange momentum."""

    spheres: BarsOfSpheres
    points: wp.array2d[wp.vec3]
    velocities: wp.array2d[wp.vec3]
    masses: wp.array2d[float]
    """Bars of the mass of each particle with its part of the gas, of spheres so far"""
    gas_masses: wp.array2d[float]
    numbers: wp.array3d[float]


@wp.func
def sums_of(common: Common, ball: MotionState, radius: float, heavy: float):
    """Return derivatives in a row."""
    sums = Sums()
    for axis in range(3):
        sums[axis] = common.change[axis]
        sums[3 + axis] = common.shift[axis]
        sums[7 + axis] = ball.position[axis]
        sums[10 + axis] = ball.velocity[axis]
        sums[13 + axis] = ball.spin[axis]
    sums[6] = common.pressed
    sums[16] = radius
    sums[17] = heavy
    return sums


@wp.func
def put_sums(motion: MotionState, sums: Sums):
    """Add the sums to the bars of a sphere's motion state."""
    motion.position += wp.vec3(sums[7], sums[8], sums[9])
    motion.velocity += wp.vec3(sums[10], sums[11], sums[12])
    motion.spin += wp.vec3(sums[13], sums[14], sums[15])
    return motion


def exchange_backwards(phase: Phase, features: Features, access: Access) -> Sequence[Adjoint]:
    """Empty adjoint of the exchange: separate kernels run it backwards."""
    return ()


@wp.func
def copy_mark(exchanges: Exchanges, world: wp.int32, sphere: wp.int32, mark: wp.int32, count: wp.int32):
    """Bring a mark's particles from before a sphere to after it."""
    for particle in range(mark * PARTICLES_A_MARK, wp.min((mark + 1) * PARTICLES_A_MARK, count)):
        exchanges.points[sphere + 1, world, particle] = exchanges.points[sphere, world, particle]
        exchanges.velocities[sphere + 1, world, particle] = exchanges.velocities[sphere, world, particle]


@cache
def exchange_again_kernel(features: Features) -> Any:
    """Recomputation kernel of the exchange of momentum; stores the results of each sphere."""
    ball_at = ball_function(features)
    settle = settling_function(features, vector_at, put_vector, sum_over_block)
    _, respond_at_mark, _ = marked_functions(features, vector_at, put_vector)

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
                            part += respond_at_mark(
                                t, working, world, mark, sphere, ball, press, last, change, shift, points[world],
                                velocities[world],
                            )  # fmt: skip
                rub = sum_over_block(part)
                if thread == 0:
                    met = ExchangeResult()
                    met.press = press
                    met.last = last
                    met.change = change
                    met.shift = shift
                    met.rub = rub
                    exchanges.met[world, sphere] = met

    return exchange_again


@cache
def particle_adjoint(features: Features) -> Any:
    """Adjoint of a particle's response to a sphere."""
    _, read_params = params_functions(features.columns, features.balloons)
    inertia = inertia_function(features)

    @wp.func
    def response_backwards(
        t: Tables, working: Working, spheres: LoggedSpheres, exchanges: Exchanges, bars: ExchangeBars, world: wp.int32,
        sphere: wp.int32, particle: wp.int32, ball: Ball, terms: Response, by_pressed: float, writes: bool,
    ):  # fmt: skip
        """Adjoint of one particle's response: bars of the common quantities and of the sphere.

        Args:
            terms: with the derivatives by friction on all, and by the push.
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
            terms.is_pressed = is_pressed(outward, excess, met.last)
            terms.overlaps = out > 0.0
            if terms.is_pressed or terms.overlaps:
                terms.place = bars.points[world, particle]
                terms.velocity = bars.velocities[world, particle]
                if wp.static(features.spheres_rub):
                    terms.friction = friction_on(t, world, params.balloon, number_of_sphere(t, sphere))
                common = Common()
                common.change = met.change
                common.shift = met.shift
                common.pressed = mass_in(met.press, PRESSED)
                mass = inertia(working, params)
                by_point, by_velocity, by_ball, by_radius, by_heavy, by_mass, by_common, by_response, _up = wp.grad(
                    particle_pairing
                )(
                    point, velocity, motion_at(spheres, world, sphere), ball.radius, ball.mass, mass, common, terms,
                    t.up,
                )  # fmt: skip
                sums = sums_of(by_common, by_ball, by_radius, by_heavy)
                if writes:
                    bars.points[world, particle] = terms.place + by_point
                    bars.velocities[world, particle] = terms.velocity + by_velocity
                    if terms.is_pressed:
                        by_mass += by_pressed
                    bars.masses[world, particle] = bars.masses[world, particle] + by_mass
                    if wp.static(features.spheres_rub):
                        by_friction = bars.spheres.rubs[world, particle, sphere] + by_response.friction
                        bars.spheres.rubs[world, particle, sphere] = by_friction
        return sums

    return response_backwards


@cache
def sphere_adjoint(features: Features) -> Any:
    """Adjoint of one sphere's exchange of momentum, by all threads of a block."""
    ball_at, response_backwards = ball_function(features), particle_adjoint(features)

    @wp.func
    def sum_of_responses(
        t: Tables, working: Working, spheres: LoggedSpheres, exchanges: Exchanges, bars: ExchangeBars, world: wp.int32,
        sphere: wp.int32, thread: wp.int32, ball: Ball, terms: Response, by_pressed: float, writes: bool,
    ):  # fmt: skip
        part = Sums()
        count = t.particles.balloon.shape[0]
        for mark in range(thread, working.near.shape[1] - 1, wp.block_dim()):
            if working.near[world, mark] > 0:
                for particle in range(mark * PARTICLES_A_MARK, wp.min((mark + 1) * PARTICLES_A_MARK, count)):
                    part += response_backwards(
                        t, working, spheres, exchanges, bars, world, sphere, particle, ball, terms, by_pressed, writes
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
        bar = bar_of_motion(bars.spheres, world, sphere)
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
        by_motion, by_radius, by_mass, by_common, by_load, by_friction, _step, _up, _bar = wp.grad(sphere_pairing)(
            motion_at(spheres, world, sphere), ball.radius, ball.mass, common, load, friction, t.step_seconds, t.up, bar
        )
        by_ground = wp.where(load.push > 0.0, by_load.push, 0.0)
        terms = Response()
        terms.step = t.step_seconds
        terms.rub = by_load.rub
        terms.torque = by_load.torque
        terms.by_push = by_ground * t.up
        found = sum_of_responses(
            t, working, spheres, exchanges, bars, world, sphere, thread, ball, terms, 0.0, False
        )  # fmt: skip
        by_change = by_common.change + (ball.mass * by_ground) * t.up + wp.vec3(found[0], found[1], found[2])
        by_shift = by_common.shift + wp.vec3(found[3], found[4], found[5])
        inertia = common_inertia(met.press, PRESSED, ball.mass, ground, t.up)
        solved = wp.inverse(inertia) * wp.vec3d(by_change)
        inertia = common_inertia(met.press, OVERLAPPING, ball.mass, wp.float64(0.0), t.up)
        terms.by_push -= wp.vec3(solved)
        terms.by_overlap = -wp.vec3(wp.inverse(inertia) * wp.vec3d(by_shift))
        taken = sum_of_responses(
            t, working, spheres, exchanges, bars, world, sphere, thread, ball, terms, found[6], True
        )  # fmt: skip
        by_sinking = float(ground * wp.dot(wp.vec3d(t.up), solved))
        by_place, by_velocity, of_radius, _u, by_height, _s = wp.grad(sinking_of_sphere)(
            ball.center, ball.velocity, ball.radius, t.up, height, t.step_seconds
        )
        by_mass += wp.dot(terms.by_push, met.change) + wp.dot(terms.by_overlap, met.shift)
        if thread == 0:
            by_motion = put_sums(by_motion, taken)
            by_motion.position += by_sinking * by_place
            by_motion.velocity += by_sinking * by_velocity
            put_bar_of_motion(bars.spheres, world, sphere, by_motion)
            by_radius += taken[16] + by_sinking * of_radius
            add_by_sphere(bars.spheres, world, sphere, by_mass + taken[17], by_radius)
            add_by_friction(bars.spheres, world, number_of_sphere(t, sphere), GROUND, by_friction)
        return by_sinking * by_height

    return exchange_back


@wp.func
def add_to_number(numbers: wp.array3d[float], world: wp.int32, particle: wp.int32, place: wp.int32, more: float):
    """Add to the bar of a particle's number."""
    numbers[world, particle, place] = numbers[world, particle, place] + more


@cache
def particle_functions(features: Features, columns: tuple[int, ...]) -> tuple[Any, Any]:
    """Adjoints of a particle's contact with solids, and of its mass."""
    _, read_params = params_functions(features.columns, features.balloons)
    around_particle, solid_contact_backwards = around_function(features), solid_contact_adjoints(features)[0]
    asked = [*ground_columns(features), features.columns.places["mass"]]
    height, friction, mass = (columns.index(column) if column in columns else -1 for column in asked)

    @wp.func
    def stand_back(
        t: Tables, working: Working, exchanges: Exchanges, bars: ExchangeBars, world: wp.int32, particle: wp.int32,
        end: float,
    ):  # fmt: skip
        params = read_params(t, world, particle)
        last = exchanges.points.shape[0] - 1
        if params.share > 0.0:
            stood = solid_contact_backwards(
                t, working, around_particle(params, end), exchanges.points[last, world, particle],
                exchanges.velocities[last, world, particle], bars.points[world, particle],
                bars.velocities[world, particle],
            )  # fmt: skip
            bars.points[world, particle] = stood.point
            bars.velocities[world, particle] = stood.velocity
            if wp.static(height >= 0):
                add_to_number(bars.numbers, world, particle, height, stood.height)
            if wp.static(friction >= 0):
                add_to_number(bars.numbers, world, particle, friction, stood.friction)

    @wp.func
    def mass_adjoint(t: Tables, bars: ExchangeBars, world: wp.int32, particle: wp.int32):
        by_share = t.particles.mass_share[particle] * bars.masses[world, particle]
        bars.masses[world, particle] = 0.0
        bars.gas_masses[world, particle] = bars.gas_masses[world, particle] + by_share
        if wp.static(mass >= 0):
            add_to_number(bars.numbers, world, particle, mass, by_share)

    return stand_back, mass_adjoint


@cache
def exchange_back_kernel(features: Features, columns: tuple[int, ...]) -> Any:
    """Backward kernel of the exchange of momentum.

    Args:
        columns: of the numbers that are derived by.
    """
    exchange_back = sphere_adjoint(features)
    stand_back, mass_adjoint = particle_functions(features, columns)
    place, split = features.columns.places["ground_height"], features.columns.balloon_width
    Numbers, add_numbers = numbers_type(features.columns.width), numbers_adder(columns)  # noqa: N806 - a type

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def turn_exchange_back(
        t: Tables, working: Working, spheres: LoggedSpheres, exchanges: Exchanges, time_in_frame: float,
        bars: ExchangeBars, of_frame: Bars,
    ):  # fmt: skip
        """Backward pass of the exchange; a block a world."""
        world, thread = wp.tid()
        marks = working.near.shape[1] - 1
        count = t.particles.balloon.shape[0]
        height = t.world_numbers[row_of_world(world, t.world_numbers.shape[0]), place - split]
        if working.near[world, marks] > 0:
            for mark in range(thread, marks, wp.block_dim()):
                if working.near[world, mark] > 0:
                    for particle in range(mark * PARTICLES_A_MARK, wp.min((mark + 1) * PARTICLES_A_MARK, count)):
                        stand_back(t, working, exchanges, bars, world, particle, time_in_frame + t.step_seconds)
            by_height = float(0.0)
            sphere = t.spheres.numbers.shape[1]
            while sphere > 0:
                sphere -= 1
                by_height += exchange_back(
                    t, working, spheres, exchanges, bars, world, sphere, thread, height
                )  # fmt: skip
            for mark in range(thread, marks, wp.block_dim()):
                if working.near[world, mark] > 0:
                    for particle in range(mark * PARTICLES_A_MARK, wp.min((mark + 1) * PARTICLES_A_MARK, count)):
                        mass_adjoint(t, bars, world, particle)
            if thread == 0:
                by_n = Numbers()
                by_n[place] = by_height
                add_numbers(of_frame.numbers_of_balloons, world, 0, by_n)

    return turn_exchange_back
