"""Adjoints of spheres that move, and meet the ground, obstacles and each other.

Changes of a sphere's course in a step are functions that Warp derives: motion, ground, obstacles, spheres. Each returns
where a sphere is then, and how fast, times the derivatives by that.

The bars that particles have found are added up, and turned into those of before. The events that change the courses of
spheres in a substep are found again, see `adjoints.spheres`, and run through from the last to the first: motion, the
ground, obstacles, other spheres. Frozen are the pairs that meet, whether they rebound, and whether friction holds.
"""

from collections.abc import Sequence
from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels import OPTIONS
from balloon_warp.kernels.adjoints.solids import Entry, entry_of, into, nearest_on_convex, slid_on_convex
from balloon_warp.kernels.adjoints.spheres import (
    BarsOfSpheres,
    Event,
    LoggedSpheres,
    add_by_friction,
    add_by_restitution,
    add_by_sphere,
    bar_of_motion,
    put_bar_of_motion,
)
from balloon_warp.kernels.adjoints.sums import Bars, numbers_adder
from balloon_warp.kernels.compose import numbers_type
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.contact import (
    MESH,
    collision,
    fall,
    friction_impulse,
    inverse_mass_of_ball,
    mean_restitution,
    rubbed,
    share_of,
    spin_by,
    stop_of,
)
from balloon_warp.kernels.laws.rigid import carried
from balloon_warp.kernels.loops.fixtures import (
    GROUND,
    Pose,
    friction_between,
    number_of_obstacle,
    number_of_sphere,
    obstacle_contact_function,
    pose_function,
)
from balloon_warp.kernels.loops.spheres import BESIDE_OBSTACLE, MEETS, ROLLS, STUCK, MotionState
from balloon_warp.kernels.phase import Access, Adjoint, Phase
from balloon_warp.kernels.tables import Solid, Tables, row_of_world, sphere_mass, sphere_radius, sphere_restitution
from balloon_warp.kernels.warps import total_newtons
from balloon_warp.kernels.working import Working


@wp.struct
class Ball:
    """Parameters of a sphere's motion, besides its state."""

    force: wp.vec3
    mass: float
    radius: float
    gravity: float
    ground_height: float
    ground_restitution: float
    friction: float  # on the ground


@wp.func
def motion_pairing(position: wp.vec3, velocity: wp.vec3, spin: wp.vec3, bar: MotionState):
    """Pairing of a motion state with its bar."""
    return wp.dot(position, bar.position) + wp.dot(velocity, bar.velocity) + wp.dot(spin, bar.spin)


@wp.func
def roll_pairing(motion: MotionState, ball: Ball, up: wp.vec3, step: float, bar: MotionState):
    """Return a sphere's course after a step beside the ground, see `loops.spheres`, times its bars."""
    moved, going, stopped = fall(
        motion.position, motion.velocity, ball.force / ball.mass, ball.radius, ball.gravity, up, ball.ground_height,
        ball.ground_restitution, step,
    )  # fmt: skip
    gain, more = rubbed(going, motion.spin, wp.vec3(), up, stopped, ball.radius, ball.friction)
    return motion_pairing(moved + step * gain, going + gain, motion.spin + more, bar)


@wp.func
def ground_pairing(motion: MotionState, ball: Ball, up: wp.vec3, step: float, bar: MotionState):
    """Return the course of a sphere that another has pushed into the ground, see `loops.spheres`, times its bars."""
    depth = ball.ground_height + ball.radius - wp.dot(motion.position, up)
    coming = -wp.dot(motion.velocity, up)
    stopped = stop_of(coming, step * coming, coming, ball.ground_restitution, step)
    going = motion.velocity + stopped * up
    gain, more = rubbed(going, motion.spin, wp.vec3(), up, stopped, ball.radius, ball.friction)
    return motion_pairing(motion.position + depth * up + step * gain, going + gain, motion.spin + more, bar)


@wp.func
def turn_pairing(
    motion: MotionState, place: wp.vec3, normal: wp.vec3, moving: wp.vec3, radius: float, up: wp.vec3, entry: Entry,
    left: float, bar: MotionState,
):  # fmt: skip
    """Return the course of a sphere that an obstacle lets go to a place, see `loops.spheres`, times its bars.

    Args:
        left: of the step, in which it slides.
    """
    coming = -wp.dot(motion.velocity - moving, normal)
    depth = wp.dot(place - motion.position, normal)
    before = coming - entry.step * entry.gravity * wp.dot(normal, up)
    stopped = stop_of(coming, depth, before, entry.restitution, entry.step)
    beyond = wp.max(entry.step * stopped - depth, 0.0)
    going = motion.velocity + stopped * normal
    gain, more = rubbed(going, motion.spin, moving, normal, stopped, radius, entry.friction)
    return motion_pairing(place + beyond * normal + left * entry.step * gain, going + gain, motion.spin + more, bar)


@wp.func
def ball_mesh_pairing(
    motion: MotionState, radius: float, let: wp.vec3, normal: wp.vec3, moving: wp.vec3, clear: float, up: wp.vec3,
    entry: Entry, left: float, bar: MotionState,
):  # fmt: skip
    """Pairing of a sphere's motion state past a mesh of constant normal with its bars.

    Args:
        clear: the radius, as a constant, with which the place was found.
        left: of the step, in which it slides.
    """
    place = motion.position + (wp.dot(let - motion.position, normal) + radius - clear) * normal
    return turn_pairing(motion, place, normal, moving, radius, up, entry, left, bar)


@wp.func
def ball_convex_pairing(
    start: wp.vec3, motion: MotionState, radius: float, solid: Solid, pose: Pose, earlier: Pose, up: wp.vec3,
    entry: Entry, bar: MotionState,
):  # fmt: skip
    """Pairing of a sphere's motion state past a convex solid with its bars."""
    here = into(pose, motion.position)
    place, normal = nearest_on_convex(here, solid, up, radius)
    left = float(1.0)
    if entry.slides:
        slid, held, more_left = slid_on_convex(into(earlier, start), here, solid, up, radius, entry)
        place = slid
        normal = held
        left = more_left
    arm = wp.quat_rotate(pose.turn, place)
    outward = wp.quat_rotate(pose.turn, normal)
    moving = carried(pose.velocity, pose.spin, arm, -entry.step)
    return turn_pairing(motion, pose.center + arm, outward, moving, radius, up, entry, left, bar)


@wp.struct
class Pair:
    """Constants of two spheres that meet."""

    restitution: float
    friction: float
    gravity: float
    step: float  # [s]


@wp.func
def spheres_pairing(
    start: wp.vec3, other_start: wp.vec3, mine: MotionState, other: MotionState, mass: float, other_mass: float,
    radius: float, other_radius: float, pair: Pair, up: wp.vec3, bar: MotionState, other_bar: MotionState,
):  # fmt: skip
    """Return the courses of two spheres that have met, see `loops.spheres`, times their bars."""
    before = other_start - start
    shift, gain, part = collision(
        before, other.position - mine.position - before, other.velocity - mine.velocity, radius + other_radius,
        pair.restitution, pair.gravity, up, pair.step,
    )  # fmt: skip
    share = share_of(mass, other_mass)
    others = share_of(other_mass, mass)
    going = mine.velocity - share * gain
    other_going = other.velocity + others * gain
    rub = wp.vec3()
    normal = up
    if wp.length_sq(gain) > 0.0:
        normal = wp.normalize(gain)
        arm = radius * normal
        other_arm = -other_radius * normal
        beside = other_going + wp.cross(other.spin, other_arm) - going - wp.cross(mine.spin, arm)
        inverse_mass = inverse_mass_of_ball(mass, radius, arm) + inverse_mass_of_ball(
            other_mass, other_radius, other_arm
        )
        rub = friction_impulse(beside, normal, inverse_mass, pair.friction * mass * share * wp.length(gain))
    left = (1.0 - part) * pair.step
    spin = mine.spin + spin_by(mass, radius, -wp.cross(radius * normal, rub))
    other_spin = other.spin + spin_by(other_mass, other_radius, wp.cross(-other_radius * normal, rub))
    place = mine.position - share * shift - (left / mass) * rub
    other_place = other.position + others * shift + (left / other_mass) * rub
    return motion_pairing(place, going - rub / mass, spin, bar) + motion_pairing(
        other_place, other_going + rub / other_mass, other_spin, other_bar
    )


@wp.func
def meet_nothing(
    t: Tables, spheres: LoggedSpheres, world: wp.int32, event: Event, end: float, bars: BarsOfSpheres,
    of_frame: Bars,
):  # fmt: skip
    """Do nothing, where there are no obstacles."""
    return


@cache
def obstacle_adjoint(features: Features, columns: tuple[int, ...]) -> Any:
    """Adjoint of a sphere's contact with an obstacle.

    Args:
        columns: of parameters by which something is derived.
    """
    if not features.fixtures:
        return meet_nothing
    meet, pose_at = obstacle_contact_function(features), pose_function(features)
    place = features.columns.places["gravity"]
    gravity = place - features.columns.balloon_width
    Numbers, add_numbers = numbers_type(features.columns.width), numbers_adder(columns)  # noqa: N806 - a type

    @wp.func
    def add_of_obstacle(
        t: Tables, bars: BarsOfSpheres, of_frame: Bars, world: wp.int32, sphere: wp.int32, fixture: wp.int32,
        by_entry: Entry,
    ):  # fmt: skip
        by_n = Numbers()
        by_n[place] = by_entry.gravity
        add_numbers(of_frame.numbers_of_balloons, world, 0, by_n)
        by_restitution = wp.float64(by_entry.restitution)
        bars.fixture_restitutions[world, fixture] = bars.fixture_restitutions[world, fixture] + by_restitution
        if wp.static(features.spheres_rub):
            add_by_friction(bars, world, number_of_sphere(t, sphere), number_of_obstacle(fixture), by_entry.friction)

    @wp.func
    def meet_obstacle_backwards(
        t: Tables, spheres: LoggedSpheres, world: wp.int32, event: Event, end: float, bars: BarsOfSpheres,
        of_frame: Bars,
    ):  # fmt: skip
        sphere, fixture = event.first, event.second
        start = spheres.sphere_starts[world, sphere]
        radius = sphere_radius(t.spheres, world, sphere)
        bar = bar_of_motion(bars, world, sphere)
        met = meet(t, world, fixture, end, start, event.mine.position, radius)
        solid = t.fixtures.solids[fixture]
        pose = pose_at(t, world, fixture, end)
        earlier = pose
        if wp.static(features.fixtures_move):
            earlier = pose_at(t, world, fixture, end - t.step_seconds)
        entry = entry_of(
            into(earlier, start), into(pose, event.mine.position), into(pose, met.let), met.part, solid, t.up, radius
        )
        entry.step = t.step_seconds
        entry.gravity = t.world_numbers[row_of_world(world, t.world_numbers.shape[0]), gravity]
        entry.restitution = t.fixtures.restitutions[row_of_world(world, t.fixtures.restitutions.shape[0]), fixture]
        if wp.static(features.spheres_rub):
            entry.friction = friction_between(t, world, number_of_sphere(t, sphere), number_of_obstacle(fixture))
        if solid.kind == MESH:
            by_mine, by_radius, _l, _n, _m, _c, _u, by_meshed, _left, _b = wp.grad(ball_mesh_pairing)(
                event.mine, radius, met.let, met.normal, met.moving, radius, t.up, entry, met.part, bar
            )
            put_bar_of_motion(bars, world, sphere, by_mine)
            add_by_sphere(bars, world, sphere, 0.0, by_radius)
            add_of_obstacle(t, bars, of_frame, world, sphere, fixture, by_meshed)
        else:
            by_start, by_motion, of_radius, _s, _pose, _earlier, _up, by_entry, _bar = wp.grad(ball_convex_pairing)(
                start, event.mine, radius, solid, pose, earlier, t.up, entry, bar
            )
            put_bar_of_motion(bars, world, sphere, by_motion)
            bars.starts[world, sphere] = bars.starts[world, sphere] + by_start
            add_by_sphere(bars, world, sphere, 0.0, of_radius)
            add_of_obstacle(t, bars, of_frame, world, sphere, fixture, by_entry)

    return meet_obstacle_backwards


@cache
def pair_adjoint(features: Features) -> Any:
    """Adjoint of the collision of two spheres."""
    gravity = features.columns.places["gravity"] - features.columns.balloon_width

    @wp.func
    def meet_pair_backwards(t: Tables, spheres: LoggedSpheres, world: wp.int32, event: Event, bars: BarsOfSpheres):
        first, second = event.first, event.second
        pair = Pair()
        own, others = sphere_restitution(t.spheres, world, first), sphere_restitution(t.spheres, world, second)
        pair.restitution = mean_restitution(own, others)
        if wp.static(features.spheres_rub):
            pair.friction = friction_between(t, world, number_of_sphere(t, first), number_of_sphere(t, second))
        pair.gravity = t.world_numbers[row_of_world(world, t.world_numbers.shape[0]), gravity]
        pair.step = t.step_seconds
        (
            by_start, by_other_start, by_mine, by_other, by_mass, by_other_mass, by_radius, by_other_radius, by_pair,
            _up, _bar, _other_bar,
        ) = wp.grad(spheres_pairing)(
            spheres.sphere_starts[world, first], spheres.sphere_starts[world, second], event.mine, event.other,
            sphere_mass(t.spheres, world, first), sphere_mass(t.spheres, world, second),
            sphere_radius(t.spheres, world, first), sphere_radius(t.spheres, world, second), pair, t.up,
            bar_of_motion(bars, world, first), bar_of_motion(bars, world, second),
        )  # fmt: skip
        put_bar_of_motion(bars, world, first, by_mine)
        put_bar_of_motion(bars, world, second, by_other)
        bars.starts[world, first] = bars.starts[world, first] + by_start
        bars.starts[world, second] = bars.starts[world, second] + by_other_start
        add_by_sphere(bars, world, first, by_mass, by_radius)
        add_by_sphere(bars, world, second, by_other_mass, by_other_radius)
        if pair.restitution > 0.0:  # of the root of a product
            by_root = 0.5 * by_pair.restitution / pair.restitution
            add_by_restitution(bars, world, first, by_root * others)
            add_by_restitution(bars, world, second, by_root * own)
        if wp.static(features.spheres_rub):
            add_by_friction(bars, world, number_of_sphere(t, first), number_of_sphere(t, second), by_pair.friction)

    return meet_pair_backwards


def roll_backwards(phase: Phase, features: Features, access: Access) -> Sequence[Adjoint]:
    """Empty adjoint of the motion of spheres: a separate kernel runs it backwards."""
    return ()


@cache
def ball_function(features: Features) -> Any:
    """Reader of the parameters of a sphere's motion."""
    places, split = features.columns.places, features.columns.balloon_width
    gravity, height, restitution = (places[name] - split for name in ("gravity", "ground_height", "ground_restitution"))

    @wp.func
    def ball_of(t: Tables, world: wp.int32, sphere: wp.int32, force: wp.vec3):
        numbers = t.world_numbers[row_of_world(world, t.world_numbers.shape[0])]
        ball = Ball()
        ball.force = force
        ball.mass = sphere_mass(t.spheres, world, sphere)
        ball.radius = sphere_radius(t.spheres, world, sphere)
        ball.gravity = numbers[gravity]
        ball.ground_height = numbers[height]
        ball.ground_restitution = numbers[restitution]
        if wp.static(features.spheres_rub):
            ball.friction = friction_between(t, world, number_of_sphere(t, sphere), GROUND)
        return ball

    return ball_of


@cache
def rolling_adjoint(features: Features, columns: tuple[int, ...]) -> Any:
    """Adjoint of a sphere's motion, or of its contact with the ground."""
    places, ball_of = features.columns.places, ball_function(features)
    gravity, height, restitution = (places[name] for name in ("gravity", "ground_height", "ground_restitution"))
    Numbers, add_numbers = numbers_type(features.columns.width), numbers_adder(columns)  # noqa: N806 - a type

    @wp.func
    def roll_event_backwards(
        t: Tables, working: Working, world: wp.int32, event: Event, quanta: wp.array3d[wp.int64], bars: BarsOfSpheres,
        of_frame: Bars,
    ):  # fmt: skip
        sphere = event.first
        bar = bar_of_motion(bars, world, sphere)
        by_ball = Ball()
        if event.kind == ROLLS:
            force = wp.vec3()
            if wp.static(features.penalties):
                force = total_newtons(quanta, world, sphere)
            ball = ball_of(t, world, sphere, force)
            by_rolled, of_ball, _up, _step, _bar = wp.grad(roll_pairing)(event.mine, ball, t.up, t.step_seconds, bar)
            bar = by_rolled
            by_ball = of_ball
            working.sphere_push_bars[world, sphere] = by_ball.force
        else:
            ball = ball_of(t, world, sphere, wp.vec3())
            by_stood, of_ball, _up, _step, _bar = wp.grad(ground_pairing)(event.mine, ball, t.up, t.step_seconds, bar)
            bar = by_stood
            by_ball = of_ball
        put_bar_of_motion(bars, world, sphere, bar)
        add_by_sphere(bars, world, sphere, by_ball.mass, by_ball.radius)
        if wp.static(features.spheres_rub):
            add_by_friction(bars, world, number_of_sphere(t, sphere), GROUND, by_ball.friction)
        by_n = Numbers()
        by_n[gravity] = by_ball.gravity
        by_n[height] = by_ball.ground_height
        by_n[restitution] = by_ball.ground_restitution
        add_numbers(of_frame.numbers_of_balloons, world, 0, by_n)

    return roll_event_backwards


@wp.func
def take_totals(bars: BarsOfSpheres, world: wp.int32, sphere: wp.int32):
    """Add the bars of a sphere that particles have found."""
    totals = bars.totals[world, sphere]
    bar = bar_of_motion(bars, world, sphere)
    bar.position += wp.vec3(totals[0], totals[1], totals[2])
    bar.velocity += wp.vec3(totals[3], totals[4], totals[5])
    put_bar_of_motion(bars, world, sphere, bar)
    add_by_sphere(bars, world, sphere, 0.0, totals[6])
    bars.numbers[world, sphere, 2] = bars.numbers[world, sphere, 2] + wp.float64(totals[7])


@cache
def roll_back_kernel(features: Features, columns: tuple[int, ...]) -> Any:
    """Backward kernel of spheres, last in a substep."""
    roll_event, meet_obstacle, meet_pair = (
        rolling_adjoint(features, columns), obstacle_adjoint(features, columns), pair_adjoint(features),
    )  # fmt: skip

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def roll_back(
        t: Tables,
        spheres: LoggedSpheres,
        quanta: wp.array3d[wp.int64],
        working: Working,
        time_in_frame: float,
        bars: BarsOfSpheres,
        of_frame: Bars,
    ):
        """Backward pass of the motion of spheres; a thread a world.

        Args:
            spheres: as the substep moves them, and the events that have changed their courses.
            quanta: forces on spheres since they last moved, as the substep began.
        """
        world = wp.tid()
        end = time_in_frame + t.step_seconds
        count = spheres.counts[world]
        if count > spheres.events.shape[1]:
            bars.crowded[world] = 1
            count = 0
        for sphere in range(t.spheres.numbers.shape[1]):
            take_totals(bars, world, sphere)
        while count > 0:
            count -= 1
            event = spheres.events[world, count]
            if event.kind == MEETS:
                meet_pair(t, spheres, world, event, bars)
            elif event.kind == BESIDE_OBSTACLE:
                meet_obstacle(t, spheres, world, event, end, bars, of_frame)
            elif event.kind == STUCK:
                bars.starts[world, event.first] = bars.starts[world, event.first] + bars.positions[world, event.first]
                bars.positions[world, event.first] = wp.vec3()
            elif sphere_radius(t.spheres, world, event.first) > 0.0:  # else it has yet to begin
                roll_event(t, working, world, event, quanta, bars, of_frame)
        for sphere in range(t.spheres.numbers.shape[1]):
            bars.positions[world, sphere] = bars.positions[world, sphere] + bars.starts[world, sphere]
            bars.starts[world, sphere] = wp.vec3()

    return roll_back
