"""Adjoints of spheres: derivatives by their numbers, the log of their contacts, the paper's rule.

By the paper's rule a particle leaves a sphere, or will. Which particles are in which sphere is frozen; the normals are
derived. A particle stores its bars of a sphere in `working.sphere_bars`, and the backward pass of spheres sums them,
see `adjoints.rolling`.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels import OPTIONS
from balloon_warp.kernels.adjoints.sums import add_exactly, note_size, parts_per_unit, sum_at
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.contact import leave_sphere, out_of_sphere, penalty_force
from balloon_warp.kernels.loops.spheres import (
    MotionState,
    colliding_function,
    motion_state_of,
    put_motion,
    rolling_function,
)
from balloon_warp.kernels.tables import Tables, WorldState, row_of_world, sphere_mass, sphere_penalty
from balloon_warp.kernels.warps import block_barrier, total_newtons
from balloon_warp.kernels.working import SphereBars, Working

COLUMNS = ("sphere_mass", "sphere_radius", "sphere_penalty", "sphere_restitution")
"""Parameters of spheres by which is derived, in the order of their columns"""


@wp.struct
class BarsOfSpheres:
    """Derivatives by the spheres of all worlds, shape (W, S)."""

    positions: wp.array2d[wp.vec3]
    velocities: wp.array2d[wp.vec3]
    spins: wp.array2d[wp.vec3]
    starts: wp.array2d[wp.vec3]
    """Bars of the places before the substep"""
    totals: wp.array2d[SphereBars]
    """Bars from all particles in a substep"""
    numbers: wp.array3d[wp.float64]
    """Bars of `COLUMNS`, added up over all frames"""
    frictions: wp.array3d[wp.float64]
    """Bars of Coulomb's coefficients between spheres, and on obstacles and the ground, added up over all frames, shape
    (W, things, things)"""
    rubs: wp.array3d[float]
    """Bars of Coulomb's coefficient of each particle on each sphere that exchanges momentum with it, added up over
    frames, shape (W, P, S); empty where none does"""
    fixture_restitutions: wp.array2d[wp.float64]
    """Bars of obstacles' coefficients of restitution, added up over all frames, shape (W, N)"""
    crowded: wp.array[wp.int32]
    """Whether more has met in a substep of a world than there is room for"""


@wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
def sum_sphere_bars(working: Working, bars: BarsOfSpheres):
    """Add up the bars of a sphere that particles have found, and clear them; a block a (world, sphere)."""
    world, sphere, thread = wp.tid()
    total = SphereBars()
    for particle in range(thread, working.sphere_bars.shape[1], wp.block_dim()):
        total += working.sphere_bars[world, particle, sphere]
        working.sphere_bars[world, particle, sphere] = SphereBars()
    found = wp.tile_sum(wp.tile(total, preserve_type=True))[0]
    if thread == 0:
        bars.totals[world, sphere] = found


@wp.func
def bar_of_motion(bars: BarsOfSpheres, world: wp.int32, sphere: wp.int32):
    """Bar of a sphere's motion state."""
    return motion_state_of(bars.positions[world, sphere], bars.velocities[world, sphere], bars.spins[world, sphere])


@wp.func
def put_bar_of_motion(bars: BarsOfSpheres, world: wp.int32, sphere: wp.int32, bar: MotionState):
    """Store the bar of a sphere's motion state."""
    bars.positions[world, sphere] = bar.position
    bars.velocities[world, sphere] = bar.velocity
    bars.spins[world, sphere] = bar.spin


@wp.func
def add_by_sphere(bars: BarsOfSpheres, world: wp.int32, sphere: wp.int32, by_mass: float, by_radius: float):
    """Add derivatives by a sphere's mass and radius."""
    bars.numbers[world, sphere, 0] = bars.numbers[world, sphere, 0] + wp.float64(by_mass)
    bars.numbers[world, sphere, 1] = bars.numbers[world, sphere, 1] + wp.float64(by_radius)


@wp.func
def add_by_restitution(bars: BarsOfSpheres, world: wp.int32, sphere: wp.int32, more: float):
    """Add a derivative by a sphere's coefficient of restitution."""
    bars.numbers[world, sphere, 3] = bars.numbers[world, sphere, 3] + wp.float64(more)


@wp.func
def add_by_friction(bars: BarsOfSpheres, world: wp.int32, first: wp.int32, second: wp.int32, more: float):
    """Add a derivative by Coulomb's coefficient of two things, where kernels read it."""
    bars.frictions[world, first, second] = bars.frictions[world, first, second] + wp.float64(more)


EVENTS_OF_A_SPHERE = 96
"""Room for changes of courses in a substep, for each sphere of a world"""


@wp.struct
class Event:
    """Event that changes a sphere's motion state."""

    kind: wp.int32  # see `loops.spheres`
    first: wp.int32  # the sphere
    second: wp.int32  # the other sphere, or the number of an obstacle
    mine: MotionState
    other: MotionState


@wp.struct
class LoggedSpheres:
    """Spheres of all worlds as a substep moves them, shape (W, S), and the events that change their courses."""

    sphere_positions: wp.array2d[wp.vec3]
    sphere_velocities: wp.array2d[wp.vec3]
    sphere_spins: wp.array2d[wp.vec3]
    sphere_starts: wp.array2d[wp.vec3]
    events: wp.array2d[Event]
    counts: wp.array[wp.int32]
    """Number of events of each world; those beyond the room are not there"""


@wp.func
def note_event(
    spheres: LoggedSpheres, world: wp.int32, kind: wp.int32, first: wp.int32, second: wp.int32, mine: MotionState,
    other: MotionState,
):  # fmt: skip
    """Log an event that changes one or two motion states."""
    place = spheres.counts[world]
    if place < spheres.events.shape[1]:
        event = Event()
        event.kind = kind
        event.first = first
        event.second = second
        event.mine = mine
        event.other = other
        spheres.events[world, place] = event
    spheres.counts[world] = place + 1


@cache
def roll_again_kernel(features: Features) -> Any:
    """Recomputation kernel of the motion of spheres, which logs the events that change it."""
    motion_state_after = rolling_function(features, note_event)
    collide_all = colliding_function(features, note_event)
    split = features.columns.balloon_width
    gravity, height, restitution = (
        features.columns.places[name] - split for name in ("gravity", "ground_height", "ground_restitution")
    )

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def roll_again(
        t: Tables, before: WorldState, quanta: wp.array3d[wp.int64], time_in_frame: float, spheres: LoggedSpheres
    ):
        """Move the spheres of a world; a thread a world.

        Args:
            quanta: forces on spheres since they last moved, as the substep began.
        """
        world = wp.tid()
        end = time_in_frame + t.step_seconds
        numbers = t.world_numbers[row_of_world(world, t.world_numbers.shape[0])]
        around = wp.vec3(numbers[gravity], numbers[height], numbers[restitution])
        spheres.counts[world] = 0
        for sphere in range(t.spheres.numbers.shape[1]):
            motion = motion_state_of(
                before.sphere_positions[world, sphere],
                before.sphere_velocities[world, sphere],
                before.sphere_spins[world, sphere],
            )
            spheres.sphere_starts[world, sphere] = motion.position
            pushed = wp.vec3()
            if wp.static(features.penalties):
                pushed = total_newtons(quanta, world, sphere) / sphere_mass(t.spheres, world, sphere)
            motion = motion_state_after(t, spheres, world, sphere, end, motion, pushed, around)
            put_motion(spheres, world, sphere, motion, True)
        if wp.static(features.spheres_meet):
            collide_all(t, spheres, world, end)

    return roll_again


@wp.struct
class BarsBesideSpheres:
    """Derivatives by the state with which a particle comes to spheres."""

    point: wp.vec3
    velocity: wp.vec3
    inflation: wp.vec3


@wp.func
def bars_of_sphere(center: wp.vec3, motion: wp.vec3, radius: float, penalty: float):
    """Return the derivatives by a sphere in a row."""
    bars = SphereBars()
    for axis in range(3):
        bars[axis] = center[axis]
        bars[3 + axis] = motion[axis]
    bars[6] = radius
    bars[7] = penalty
    return bars


@wp.func
def sphere_pairing(
    point: wp.vec3, velocity: wp.vec3, center: wp.vec3, motion: wp.vec3, radius: float, penalty: float,
    inflation: wp.vec3, up: wp.vec3, step: float, point_bar: wp.vec3, velocity_bar: wp.vec3, push_bar: wp.vec3,
):  # fmt: skip
    """Pairing of a particle's place, velocity and push at a sphere with their bars."""
    out, after, outward = leave_sphere(point, velocity, center, motion, radius, up, step)
    push = penalty_force(penalty, inflation, outward)
    return wp.dot(out, point_bar) + wp.dot(after, velocity_bar) + wp.dot(push, push_bar)


@wp.func
def exit_pairing(point: wp.vec3, center: wp.vec3, radius: float, up: wp.vec3, point_bar: wp.vec3, normal_bar: wp.vec3):
    """Pairing of a particle's predicted exit from a sphere, and of the normal there, with their bars."""
    out, normal = out_of_sphere(point, wp.vec3(), center, radius, up)
    return wp.dot(out, point_bar) + wp.dot(normal, normal_bar)


@cache
def past_spheres_function(sphere_at: Any) -> Any:
    """Return the function that moves a particle out of the first spheres."""

    @wp.func
    def past_spheres(t: Tables, spheres: Any, world: wp.int32, most: wp.int32, point: wp.vec3, velocity: wp.vec3):
        """Return a particle's point and velocity past so many spheres, and whether it was in any."""
        is_met = bool(False)
        for sphere in range(most):
            center, motion, radius = sphere_at(t, spheres, world, sphere)
            out, after, outward = leave_sphere(point, velocity, center, motion, radius, t.up, t.step_seconds)
            point = out
            velocity = after
            is_met = is_met or wp.length_sq(outward) > 0.0
        return point, velocity, is_met

    return past_spheres


@cache
def leaving_spheres_adjoint(features: Features, sphere_at: Any) -> Any:
    """Adjoint of a particle's contact with spheres, from the last to the first."""
    past_spheres = past_spheres_function(sphere_at)

    @wp.func
    def leave_spheres_backwards(
        t: Tables, spheres: Any, working: Working, world: wp.int32, particle: wp.int32, point: wp.vec3,
        velocity: wp.vec3, inflation: wp.vec3, point_bar: wp.vec3, velocity_bar: wp.vec3,
    ):  # fmt: skip
        bars = BarsBesideSpheres()
        bars.point = point_bar
        bars.velocity = velocity_bar
        sphere = t.spheres.numbers.shape[1]
        _out, _after, is_met = past_spheres(t, spheres, world, sphere, point, velocity)
        while is_met and sphere > 0:
            sphere -= 1
            came, before, _met = past_spheres(t, spheres, world, sphere, point, velocity)
            center, motion, radius = sphere_at(t, spheres, world, sphere)
            if wp.length_sq(came - center) < radius * radius:
                at, going, by_center, by_motion, by_radius, by_penalty, by_push, _u, _h, _p, _v, _b = wp.grad(
                    sphere_pairing
                )(
                    came, before, center, motion, radius, sphere_penalty(t.spheres, world, sphere), inflation, t.up,
                    t.step_seconds, bars.point, bars.velocity, working.sphere_push_bars[world, sphere],
                )  # fmt: skip
                bars.point = at
                bars.velocity = going
                bars.inflation += by_push
                more = bars_of_sphere(by_center, by_motion, by_radius, by_penalty)
                working.sphere_bars[world, particle, sphere] = working.sphere_bars[world, particle, sphere] + more
        return bars

    return leave_spheres_backwards


@cache
def predicted_spheres_adjoint(features: Features, sphere_at: Any) -> Any:
    """Adjoint of the predicted deflection by spheres, from the last to the first."""
    past_spheres = past_spheres_function(sphere_at)

    @wp.func
    def predict_deflection_by_spheres_backwards(
        t: Tables, spheres: Any, working: Working, world: wp.int32, particle: wp.int32, ahead: wp.vec3,
        place_bar: wp.vec3, normal_bar: wp.vec3,
    ):  # fmt: skip
        """Return the derivative by the place ahead.

        Args:
            normal_bar: derivative by the normal of the last that is met.
        """
        sphere = t.spheres.numbers.shape[1]
        _out, _after, is_met = past_spheres(t, spheres, world, sphere, ahead, wp.vec3())
        while is_met and sphere > 0:
            sphere -= 1
            came, _before, _met = past_spheres(t, spheres, world, sphere, ahead, wp.vec3())
            center, _motion, radius = sphere_at(t, spheres, world, sphere)
            if wp.length_sq(came - center) < radius * radius:
                by_place, by_center, by_radius, _up, _place, _normal = wp.grad(exit_pairing)(
                    came, center, radius, t.up, place_bar, normal_bar
                )
                place_bar = by_place
                normal_bar = wp.vec3()
                more = bars_of_sphere(by_center, wp.vec3(), by_radius, 0.0)
                working.sphere_bars[world, particle, sphere] = working.sphere_bars[world, particle, sphere] + more
        return place_bar

    return predict_deflection_by_spheres_backwards


OF_BALLS = wp.constant(3)
"""Kind of the first sums of spheres, after those of particles: by velocity, spin and start, by mass and by radius"""
KINDS_OF_BALLS, BALL_SUMS = 5, 11
"""Number of kinds of sums of spheres, and of entries of each sphere"""


@wp.struct
class BallShare:
    """Derivatives by a contact's inputs of a sphere."""

    velocity: wp.vec3
    spin: wp.vec3
    start: wp.vec3  # its place before the substep
    mass: float
    radius: float


@wp.func
def note_ball(bars: Any, world: wp.int32, found: BallShare):
    """Record the magnitude of a contact's bars of a sphere."""
    note_size(bars.largest, world, OF_BALLS, wp.max(wp.abs(found.velocity)))
    note_size(bars.largest, world, OF_BALLS + 1, wp.max(wp.abs(found.spin)))
    note_size(bars.largest, world, OF_BALLS + 2, wp.max(wp.abs(found.start)))
    note_size(bars.largest, world, OF_BALLS + 3, wp.abs(found.mass))
    note_size(bars.largest, world, OF_BALLS + 4, wp.abs(found.radius))


@wp.func
def add_ball(bars: Any, world: wp.int32, sphere: wp.int32, found: BallShare):
    """Add a contact's derivatives to the sums of a sphere, by any thread in any order."""
    of_velocities = parts_per_unit(bars.largest, world, OF_BALLS)
    of_spins = parts_per_unit(bars.largest, world, OF_BALLS + 1)
    of_starts = parts_per_unit(bars.largest, world, OF_BALLS + 2)
    for axis in range(3):
        add_exactly(bars.ball_sums, world, sphere, axis, of_velocities, found.velocity[axis])
        add_exactly(bars.ball_sums, world, sphere, axis + 3, of_spins, found.spin[axis])
        add_exactly(bars.ball_sums, world, sphere, axis + 6, of_starts, found.start[axis])
    add_exactly(bars.ball_sums, world, sphere, 9, parts_per_unit(bars.largest, world, OF_BALLS + 3), found.mass)
    add_exactly(bars.ball_sums, world, sphere, 10, parts_per_unit(bars.largest, world, OF_BALLS + 4), found.radius)


@wp.func
def take_ball(bars: Any, world: wp.int32, sphere: wp.int32):
    """Add a sphere's sums to its derivatives, and clear them."""
    velocity = wp.vec3()
    spin = wp.vec3()
    start = wp.vec3()
    for axis in range(3):
        velocity[axis] = sum_at(bars.ball_sums, bars.largest, world, sphere, axis, OF_BALLS)
        spin[axis] = sum_at(bars.ball_sums, bars.largest, world, sphere, axis + 3, OF_BALLS + 1)
        start[axis] = sum_at(bars.ball_sums, bars.largest, world, sphere, axis + 6, OF_BALLS + 2)
    by_mass = sum_at(bars.ball_sums, bars.largest, world, sphere, 9, OF_BALLS + 3)
    by_radius = sum_at(bars.ball_sums, bars.largest, world, sphere, 10, OF_BALLS + 4)
    bars.spheres.velocities[world, sphere] = bars.spheres.velocities[world, sphere] + velocity
    bars.spheres.spins[world, sphere] = bars.spheres.spins[world, sphere] + spin
    bars.spheres.starts[world, sphere] = bars.spheres.starts[world, sphere] + start
    add_by_sphere(bars.spheres, world, sphere, by_mass, by_radius)
    for entry in range(BALL_SUMS):
        bars.ball_sums[world, sphere, entry] = wp.int64(0)


@wp.func
def keep_balls(state: WorldState, bars: Any, world: wp.int32, thread: wp.int32, sweep: wp.int32):
    """Keep the velocities and spins of all spheres before a sweep."""
    for sphere in range(thread, bars.ball_sums.shape[1], wp.block_dim()):
        bars.ball_velocities[sweep, world, sphere] = state.sphere_velocities[world, sphere]
        bars.ball_spins[sweep, world, sphere] = state.sphere_spins[world, sphere]


@wp.func
def restore_balls(state: WorldState, bars: Any, world: wp.int32, thread: wp.int32, sweep: wp.int32):
    """Restore the velocities and spins of all spheres as they were before a sweep."""
    for sphere in range(thread, bars.ball_sums.shape[1], wp.block_dim()):
        state.sphere_velocities[world, sphere] = bars.ball_velocities[sweep, world, sphere]
        state.sphere_spins[world, sphere] = bars.ball_spins[sweep, world, sphere]
    block_barrier()
