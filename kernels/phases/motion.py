"""Motion of particles, spheres and bodies by all forces.

A particle moves: a = F / m; v += h a; x += h v, in the order of the paper's listing. But of a balloon's damping c a
force -c v is in F, and v' = v + h F / (m + h c): the damping is that of the speed at the end, so that the speed goes to
F / c and never beyond, however short the time m / c is for the step.

In a medium that resists it a particle answers to forces otherwise. Under the drag at the speed before a step, a light
particle in a dense medium would turn back; under the drag averaged over a step in which nothing else acts, it would
become too fast. So forces and drag act together. Where both stay along a line, m dv/dt = F - k |v| v has the solution

    v' = (v + g F) / (1 + g k |v|),  g = (h / m) tanh(t) / t,  t = (h / m) sqrt(k |F|):

it goes to the terminal speed sqrt(F / k), and never beyond, however long the step. F has the inflation, too: that of a
gas by its pressure of the substep before, which only g is told. The pressure of this one follows from what velocity a
force gives, g / (1 + g k |v|).
"""

from dataclasses import replace
from typing import Any

import warp as wp

from balloon_warp.kernels.adjoints.pull import expect_backwards
from balloon_warp.kernels.adjoints.rolling import roll_backwards
from balloon_warp.kernels.algebra import scaled, squared_length, times
from balloon_warp.kernels.contact.free_frames import HURRIED
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.lanes import Lanes, all_positive
from balloon_warp.kernels.laws.springs import excess, moves_of_ends
from balloon_warp.kernels.loops.bodies import body_mass, body_motion_function
from balloon_warp.kernels.loops.net_force import held_string_pull
from balloon_warp.kernels.loops.spheres import colliding_function, may_meet, motion_at, put_motion, rolling_function
from balloon_warp.kernels.memory import fixed_float_at, float_at, int_pair_at, put_int_unless
from balloon_warp.kernels.phase import Access, by_grad, phase
from balloon_warp.kernels.phases.inflation import inflate
from balloon_warp.kernels.tables import Tables, WorldState, check_particle, row_of_world, sphere_mass, sphere_radius
from balloon_warp.kernels.warps import set_quanta, total_newtons
from balloon_warp.kernels.working import Working


@wp.func
def response(mass: float, step_seconds: float):
    """Return the velocity gained in a step per newton [m/s/N]; a particle without mass is fixed.

    Its derivative by the mass is 0 then: both branches are derived, and one divides.
    """
    return wp.where(mass > 0.0, step_seconds / wp.where(mass > 0.0, mass, 1.0), 0.0)


@wp.func_native(
    """
    wp::vec_t<8, wp::float32> gains;
    for (int lane = 0; lane < 8; ++lane)
        gains.c[lane] = mass.c[lane] > 0.0f ? step_seconds / mass.c[lane] : 0.0f;
    return gains;
    """,
    adj_snippet="""
    for (int lane = 0; lane < 8; ++lane) {
        const float inverse = mass.c[lane] > 0.0f ? 1.0f / mass.c[lane] : 0.0f;
        adj_mass.c[lane] -= adj_ret.c[lane] * step_seconds * inverse * inverse;
        adj_step_seconds += adj_ret.c[lane] * inverse;
    }
    """,
)
def response(mass: Lanes, step_seconds: float) -> Lanes:  # noqa: F811 - an overload
    """Return the gains h / m of eight particles."""
    ...


@wp.func
def damped_response(inertia: Any, share: Any, damping: Any, step_seconds: float):
    """Return the velocity gained in a step per newton, where a balloon's damping [N s/m] is that of the step's end."""
    return response(inertia + step_seconds * times(share, damping), step_seconds)


@wp.func
def kick(velocity: Any, force: Any, gain: Any):
    """Return the new velocity v + g F, see `damped_response`."""
    return velocity + scaled(force, gain)


@wp.func
def respond_undamped(t: Any, inertia: Any):
    """Return the velocity gained in a step per newton."""
    return response(inertia, t.step_seconds)


@wp.func
def respond_damped(t: Any, params: Any, inertia: Any, damping: Any):
    """Return the velocity gained in a step per newton, of a balloon with damping."""
    return damped_response(inertia, params.share, damping, t.step_seconds)


@phase(
    "particle", {"gain": float}, when=lambda features: not features.resists, light=True,
    once=lambda features: not features.gas_changes, adjoint=by_grad,
)  # fmt: skip
def respond(features: Features, access: Access) -> Any:
    """Find the velocity that a force gives a particle."""
    return respond_damped if features.damped else respond_undamped


@phase(
    "particle", {"free_velocity": wp.vec3}, when=lambda features: features.gas and not features.resists,
    adjoint=by_grad,
)  # fmt: skip
@wp.func
def free(velocity: Any, force: Any, gain: Any):
    """Accelerate a particle by all forces except inflation, from which the gas's pressure follows."""
    return kick(velocity, force, gain)


@wp.func
def push_by_all(velocity: Any, force: Any, inflation: Any, gain: Any):
    """Return the velocity after all forces."""
    return kick(velocity, force + inflation, gain)


@wp.func
def push_on(free_velocity: Any, inflation: Any, gain: Any):
    """Return the velocity after the inflation, once all else has acted."""
    return kick(free_velocity, inflation, gain)


@phase("particle", {"velocity": wp.vec3}, adjoint=by_grad)
def push(features: Features, access: Access) -> Any:
    """Accelerate a particle by all forces."""
    return push_on if features.gas or features.resists else push_by_all


@wp.func
def moved(t: Any, point: Any, velocity: Any):
    """Return where a point is after a step: x + h v [m]."""
    return point + scaled(velocity, t.step_seconds)


@phase("particle", {"point": wp.vec3}, when=lambda features: features.forward_euler, adjoint=by_grad)
def move_first(features: Features, access: Access) -> Any:
    """Move a particle by the old velocity: forward Euler."""
    return moved


@phase("particle", {"point": wp.vec3}, when=lambda features: not features.forward_euler, adjoint=by_grad)
def move(features: Features, access: Access) -> Any:
    """Move a particle by the new velocity: symplectic Euler."""
    return moved


expect = replace(
    inflate, name="expect", writes={"expected": wp.vec3}, when=lambda features: features.resists,
    adjoint=expect_backwards,
)  # fmt: skip
"""The force of the inflation on a particle by the pressure that is known so far [N]"""
SERIES = 1.0e-3
"""Square below which the hyperbolic tangent is taken by its series"""


@wp.func
def tangent_ratio(squared: float):
    """Return tanh(t) / t by the square of t."""
    ratio = 1.0 - squared / 3.0
    if squared > SERIES:
        root = wp.sqrt(squared)
        ratio = wp.tanh(root) / root
    return ratio


@phase(
    "particle", {"gain": float, "free_velocity": wp.vec3}, when=lambda features: features.resists, adjoint=by_grad
)  # fmt: skip
def resist(features: Features, access: Access) -> Any:
    """Find the velocity that a force gives a particle in a medium, and accelerate it by all but the inflation."""
    resistance = features.resistance
    place = features.columns.places["damping"] if features.damped else -1

    @wp.func
    def resist(
        t: Any, params: Any, inertia: float, point: wp.vec3, velocity: wp.vec3, force: wp.vec3, expected: wp.vec3,
        area_vector: wp.vec3, water_load: wp.vec4, time: float,
    ):  # fmt: skip
        k = resistance(
            point, velocity, params.mass, params.share, area_vector, water_load, t.up, t.step_seconds, time, params.n
        )
        damping = float(0.0)
        if wp.static(place >= 0):
            damping = params.n[place]
        gain = damped_response(inertia, params.share, damping, t.step_seconds)
        resisted = k * wp.length(velocity)
        others = force + resisted * velocity
        gain *= tangent_ratio(gain * gain * k * wp.length(others + expected))
        slower = 1.0 / (1.0 + gain * resisted)
        return slower * gain, slower * (velocity + gain * others)

    return resist


@phase("spring", when=lambda features: features.corrected)
def correct(features: Features, access: Access) -> Any:
    """Shorten a spring that is too long; no two of one color end at one particle."""
    at, put, velocity_at, put_velocity = access.at, access.put, access.velocity_at, access.put_velocity
    limit_column = features.columns.places["correction_limit"] - features.columns.balloon_width

    @wp.func
    def correct(t: Tables, points: Any, velocities: Any, world: wp.int32, spring: wp.int32):
        ends = int_pair_at(t.correction.particles, spring)
        p = ends[0]
        q = ends[1]
        at_p = at(points, p)
        at_q = at(points, q)
        limit = t.world_numbers[row_of_world(world, t.world_numbers.shape[0]), limit_column]
        too_long = excess(at_q - at_p, float_at(t.correction.rest_lengths, spring), limit)
        if wp.length_sq(too_long) > 0.0:  # few are: the writes of the others would take longer than all the rest
            move_p, move_q = moves_of_ends(
                float_at(t.particles.mass_share, p), float_at(t.particles.mass_share, q), too_long
            )
            put(points, p, at_p + move_p)
            put(points, q, at_q + move_q)
            put_velocity(velocities, p, velocity_at(velocities, p) + move_p / t.step_seconds)
            put_velocity(velocities, q, velocity_at(velocities, q) + move_q / t.step_seconds)

    return correct


@phase("sphere", when=lambda features: features.spheres > 0, adjoint=roll_backwards)
def roll(features: Features, access: Access) -> Any:
    """Move a sphere, under the forces since the last substep, or where spheres exchange momentum without contact."""
    motion_state_after = rolling_function(features)
    split = features.columns.balloon_width
    gravity, height, restitution = (
        features.columns.places[name] - split for name in ("gravity", "ground_height", "ground_restitution")
    )

    @wp.func
    def roll(t: Tables, spheres: Any, world: wp.int32, sphere: wp.int32, end: float):
        numbers = t.world_numbers[row_of_world(world, t.world_numbers.shape[0])]
        around = wp.vec3(numbers[gravity], numbers[height], numbers[restitution])
        pushed = wp.vec3()
        if wp.static(features.penalties):
            pushed = total_newtons(spheres.sphere_quanta, world, sphere) / sphere_mass(t.spheres, world, sphere)
            set_quanta(spheres.sphere_quanta, world, sphere, wp.vec3())
        else:
            spheres.sphere_forces[world, sphere] = wp.vec3()
        before = motion_at(spheres, world, sphere)
        if wp.static(features.keeps_starts):
            spheres.sphere_starts[world, sphere] = before.position
        course = motion_state_after(t, spheres, world, sphere, end, before, pushed, around)
        put_motion(spheres, world, sphere, course, wp.static(features.spheres_rub))

    return roll


@phase("sphere", when=lambda features: features.spheres_take_forces)
@wp.func
def apply_sphere_forces(t: Tables, spheres: Any, world: wp.int32, sphere: wp.int32):
    """Apply the substep's forces to a sphere before it exchanges momentum, so that none is left as a frame ends."""
    push = total_newtons(spheres.sphere_quanta, world, sphere)
    set_quanta(spheres.sphere_quanta, world, sphere, wp.vec3())
    if sphere_radius(t.spheres, world, sphere) > 0.0:  # it is there
        gain = t.step_seconds / sphere_mass(t.spheres, world, sphere) * push
        spheres.sphere_velocities[world, sphere] = spheres.sphere_velocities[world, sphere] + gain


@phase("world", when=lambda features: features.bodies_take_forces)
@wp.func
def apply_body_forces(t: Tables, state: WorldState, working: Working, world: wp.int32):
    """Push free bodies by the forces and torques of the substep."""
    for body in range(state.body_positions.shape[1]):
        push = t.step_seconds * total_newtons(working.body_quanta, world, body)
        twist = t.step_seconds * total_newtons(working.body_turning_quanta, world, body)
        set_quanta(working.body_quanta, world, body, wp.vec3())
        set_quanta(working.body_turning_quanta, world, body, wp.vec3())
        gain = push / body_mass(t, world, body)
        state.body_velocities[world, body] = state.body_velocities[world, body] + gain
        state.body_momenta[world, body] = state.body_momenta[world, body] + twist


@wp.func
def may_any_meet(t: Tables, spheres: Any, world: wp.int32, thread: wp.int32):
    """Return whether any of a thread's pairs of spheres may meet."""
    count = t.spheres.numbers.shape[1]
    near = bool(False)
    for pair in range(thread, count * count, wp.block_dim()):
        if pair // count < pair % count:
            near = near or may_meet(t, spheres, world, pair // count, pair % count)
    return near


@phase("world", when=lambda features: features.spheres_meet, due=lambda features: may_any_meet, adjoint=roll_backwards)
def collide(features: Features, access: Access) -> Any:
    """Resolve collisions of spheres that have moved."""
    return colliding_function(features)


@phase("world", when=lambda features: features.bodies > 0)
def move_bodies(features: Features, access: Access) -> Any:
    """Move free bodies, once spheres have."""
    return body_motion_function(features)


@phase("world", when=lambda features: features.ties)
def pull_tied_bodies(features: Features, access: Access) -> Any:
    """Place the anchors that bodies carry, and pull at these with the opposite of the forces on particles.

    Both ends get the same force, of where both are as the substep begins: momentum stays, as angular momentum does.
    """
    pull_of_held_string = held_string_pull(features)

    @wp.func
    def pull_tied_bodies(
        t: Tables, state: WorldState, working: Working, points: Any, velocities: Any, world: wp.int32, time: float
    ):  # fmt: skip
        for body in range(state.body_positions.shape[1]):
            working.body_tugs[world, body] = wp.vec3()
            working.body_twists[world, body] = wp.vec3()
        for held in range(t.strings.particles.shape[0]):
            string = t.strings.order[held][0]
            body = t.strings.order[held][1]
            if body >= 0:
                arm = wp.quat_rotate(state.body_turns[world, body], t.strings.anchors[3 * world + 2, string])
                t.strings.anchors[3 * world, string] = state.body_positions[world, body] + arm
                push = -t.step_seconds * pull_of_held_string(t, world, held, points, velocities, time)
                working.body_tugs[world, body] = working.body_tugs[world, body] + push / body_mass(t, world, body)
                working.body_twists[world, body] = working.body_twists[world, body] + wp.cross(arm, push)
        for body in range(state.body_positions.shape[1]):
            state.body_velocities[world, body] = state.body_velocities[world, body] + working.body_tugs[world, body]
            state.body_momenta[world, body] = state.body_momenta[world, body] + working.body_twists[world, body]

    return pull_tied_bodies


def _is_free(features: Features) -> bool:
    return features.watched


@phase("particle", {"start": wp.vec3}, when=_is_free)
@wp.func
def store_start(point: Any):
    """Store a particle's position at the begin of its substep."""
    return point


@wp.func
def is_faster(t: Any, travel_limit: Any, start: Any, point: Any):
    """Return whether any particle of eight may be faster than allowed, with a margin."""
    most = times(travel_limit, travel_limit) * (0.999 / (float(t.substeps) * float(t.substeps)))
    return not all_positive(most - squared_length(point - start))


def _hurries(features: Features, access: Access) -> Any:
    if not access.world:  # of one particle it is asked as fast
        return None

    return is_faster


@phase("particle", when=_is_free, rare=_hurries)
@wp.func
def check_speed(t: Tables, working: Working, world: wp.int32, start: wp.vec3, point: wp.vec3):
    """Mark a world with a particle faster than assumed, whose frame is invalid."""
    travel_limit = fixed_float_at(working.travel_limits, world)
    substeps = float(t.substeps)
    stays = substeps * substeps * wp.length_sq(point - start) < travel_limit * travel_limit  # not if it is no number
    put_int_unless(stays, working.verdicts, world, HURRIED)
    put_int_unless(stays, working.any_busy, 0, 1)


@phase("particle", last=True, when=lambda features: features.frames == "all")
@wp.func
def check(t: Tables, state: WorldState, points: Any, params: Any, particle: wp.int32, number: wp.int32):
    """Record the first particle at a place that it cannot have."""
    balloon, share = params.balloon, params.share
    check_particle(t.health, state.first_bad, params.world, particle, number, balloon, share, points)
