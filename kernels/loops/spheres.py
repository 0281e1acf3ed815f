"""Spheres: their state, motion, collisions with each other, and exchange of momentum with particles.

Exchange of momentum between spheres and particles, wherever both are kept, see `laws.contact`. A schedule sums
`press_on_ball` over the particles until the sphere's change of velocity is settled, then has each particle answer.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.contact import (
    MOST_TURNS,
    PRESSED,
    Press,
    change_of_body,
    collision,
    comes_near,
    fall,
    friction_impulse,
    gain_of_particle,
    inverse_mass_of_ball,
    is_pressed,
    is_settled,
    mass_in,
    mean_restitution,
    meet_sphere,
    press_of_particle,
    push_of_ground,
    rubbed,
    share_of,
    sinking_of_sphere,
    spin_by,
    stop_of,
)
from balloon_warp.kernels.laws.rigid import rub_on
from balloon_warp.kernels.loops.fixtures import (
    GROUND,
    friction_between,
    number_of_obstacle,
    number_of_sphere,
    obstacle_contact_function,
)
from balloon_warp.kernels.tables import Tables, WorldState, row_of_world, sphere_mass, sphere_radius, sphere_restitution
from balloon_warp.kernels.warps import put_word, set_quanta, shared_words, total_newtons, word_at
from balloon_warp.kernels.working import Working

VECTOR_BYTES, QUANTA_BYTES = wp.constant(12), wp.constant(24)
"""Bytes of a vector, and of a force in whole numbers"""


@wp.struct
class Spheres:
    """Arrays of the shape (world_count, sphere_count); those that a scene does not need are empty."""

    sphere_positions: wp.array2d[wp.vec3]
    sphere_velocities: wp.array2d[wp.vec3]
    sphere_spins: wp.array2d[wp.vec3]
    sphere_starts: wp.array2d[wp.vec3]
    """Positions before this substep [m]"""
    sphere_forces: wp.array2d[wp.vec3]
    """Forces of the momentum that is exchanged [N]"""
    sphere_quanta: wp.array3d[wp.int64]
    """Forces by the paper's rule, or of phases, since the spheres last moved, see `fixed_point`"""


@wp.func
def spheres_in_state(t: Tables, state: WorldState, working: Working):
    """Return the spheres in the state."""
    spheres = Spheres()
    spheres.sphere_positions = state.sphere_positions
    spheres.sphere_velocities = state.sphere_velocities
    spheres.sphere_spins = state.sphere_spins
    spheres.sphere_starts = working.sphere_starts
    spheres.sphere_forces = state.sphere_forces
    spheres.sphere_quanta = working.sphere_quanta
    return spheres


@wp.func
def sphere_at(t: Tables, spheres: Any, world: wp.int32, sphere: wp.int32):
    """Return center, velocity and radius of a sphere, which may stand in the state."""
    return (
        spheres.sphere_positions[world, sphere],
        spheres.sphere_velocities[world, sphere],
        sphere_radius(t.spheres, world, sphere),
    )


@cache
def shared_spheres(count: int) -> tuple[Any, Any, Any]:
    """Return functions that load a world's spheres into shared memory, store them, and read one sphere there.

    The last returns the center, velocity and radius of a sphere.
    """
    words = shared_words("spheres", count * 22)
    places, motions, radii = (count * words_before for words_before in (6, 9, 21))

    @wp.func
    def vectors(world: wp.int32, row: wp.int32):
        """Return a row of shared vectors, behind all quanta, as if it were that of a world."""
        first = words() + wp.uint64(count * (QUANTA_BYTES + row * VECTOR_BYTES))
        return wp.array(ptr=first - wp.uint64(world * count * VECTOR_BYTES), shape=(world + 1, count), dtype=wp.vec3)

    @wp.func
    def share_spheres(t: Tables, state: WorldState, world: wp.int32, thread: wp.int32, penalties: bool):
        """Return the spheres of a world; a barrier must follow.

        Args:
            penalties: Whether forces are those that have been summed and are still to act.
        """
        spheres = Spheres()
        spheres.sphere_positions = vectors(world, 0)
        spheres.sphere_velocities = vectors(world, 1)
        spheres.sphere_spins = vectors(world, 2)
        spheres.sphere_starts = vectors(world, 3)
        spheres.sphere_forces = vectors(world, 4)
        spheres.sphere_quanta = wp.array(
            ptr=words() - wp.uint64(world * count * QUANTA_BYTES), shape=(world + 1, count, 3), dtype=wp.int64
        )
        for sphere in range(thread, count, wp.block_dim()):
            put_word(words(), radii + sphere, sphere_radius(t.spheres, world, sphere))
            spheres.sphere_positions[world, sphere] = state.sphere_positions[world, sphere]
            spheres.sphere_velocities[world, sphere] = state.sphere_velocities[world, sphere]
            spheres.sphere_spins[world, sphere] = state.sphere_spins[world, sphere]
            spheres.sphere_forces[world, sphere] = state.sphere_forces[world, sphere]
            set_quanta(
                spheres.sphere_quanta, world, sphere, wp.where(penalties, state.sphere_forces[world, sphere], wp.vec3())
            )
        return spheres

    @wp.func
    def put_spheres(state: WorldState, world: wp.int32, thread: wp.int32, spheres: Spheres, penalties: bool):
        """Store the spheres of a world, after a barrier.

        Args:
            penalties: Whether forces are those that have been summed.
        """
        for sphere in range(thread, count, wp.block_dim()):
            state.sphere_positions[world, sphere] = spheres.sphere_positions[world, sphere]
            state.sphere_velocities[world, sphere] = spheres.sphere_velocities[world, sphere]
            state.sphere_spins[world, sphere] = spheres.sphere_spins[world, sphere]
            force = spheres.sphere_forces[world, sphere]
            if penalties:
                force = total_newtons(spheres.sphere_quanta, world, sphere)
            state.sphere_forces[world, sphere] = force

    @wp.func
    def shared_vector(first: wp.int32, sphere: wp.int32):
        """Return a vector of a row that begins with a given word of shared memory."""
        word = first + 3 * sphere
        return wp.vec3(word_at(words(), word), word_at(words(), word + 1), word_at(words(), word + 2))

    @wp.func
    def shared_sphere_at(t: Tables, spheres: Any, world: wp.int32, sphere: wp.int32):
        return shared_vector(places, sphere), shared_vector(motions, sphere), word_at(words(), radii + sphere)

    return share_spheres, put_spheres, shared_sphere_at


ROLLS, BESIDE_GROUND, BESIDE_OBSTACLE, STUCK, MEETS = (wp.constant(number) for number in range(5))
"""Kinds of changes of a sphere's course in a step: motion, the ground or an obstacle beside it, several obstacles that
leave it no place, and another sphere"""


@wp.struct
class MotionState:
    """Position and velocities of a sphere."""

    position: wp.vec3
    velocity: wp.vec3
    spin: wp.vec3  # [rad/s]


@wp.func
def motion_state_of(position: wp.vec3, velocity: wp.vec3, spin: wp.vec3):
    motion = MotionState()
    motion.position = position
    motion.velocity = velocity
    motion.spin = spin
    return motion


@wp.func
def motion_at(spheres: Any, world: wp.int32, sphere: wp.int32):
    """Return the course of a sphere as it is now."""
    return motion_state_of(
        spheres.sphere_positions[world, sphere],
        spheres.sphere_velocities[world, sphere],
        spheres.sphere_spins[world, sphere],
    )


@wp.func
def put_motion(spheres: Any, world: wp.int32, sphere: wp.int32, motion: MotionState, spins: bool):
    """Store a sphere's course, with its spin where it has any."""
    spheres.sphere_positions[world, sphere] = motion.position
    spheres.sphere_velocities[world, sphere] = motion.velocity
    if spins:
        spheres.sphere_spins[world, sphere] = motion.spin


@cache
def rubbing_function(features: Features) -> Any:
    """Return the function for the friction of a sphere on something immovable."""

    @wp.func
    def rub(
        t: Tables,
        world: wp.int32,
        sphere: wp.int32,
        motion: MotionState,
        moving: wp.vec3,
        normal: wp.vec3,
        stopped: float,
        friction: float,
        seconds: float,
    ):
        """Return a sphere's course after friction at a contact that has stopped it.

        Args:
            moving: Velocity of the other surface there [m/s].
            stopped: Change of the sphere's velocity along the normal [m/s].
            friction: Coulomb friction coefficient of the pair.
            seconds: Remaining time of the step from the contact [s].
        """
        if wp.static(features.spheres_rub):
            if stopped > 0.0:
                gain, more = rubbed(
                    motion.velocity, motion.spin, moving, normal, stopped, sphere_radius(t.spheres, world, sphere),
                    friction,
                )  # fmt: skip
                motion.position += seconds * gain
                motion.velocity += gain
                motion.spin += more
        return motion

    return rub


@cache
def ground_rubbing_function(features: Features) -> Any:
    """Return the function for the friction of a sphere on the ground."""
    rub = rubbing_function(features)

    @wp.func
    def rub_on_ground(t: Tables, world: wp.int32, sphere: wp.int32, motion: MotionState, stopped: float):
        """Return a sphere's course after friction on the ground, as in `rub`."""
        friction = friction_between(t, world, number_of_sphere(t, sphere), GROUND)
        return rub(t, world, sphere, motion, wp.vec3(), t.up, stopped, friction, t.step_seconds)

    return rub_on_ground


@cache
def leaving_function(features: Features, note: Any = None) -> Any:
    """Return the function that moves a sphere out of obstacles.

    Args:
        note: function that is told of each change of a course, and the course before it; none where nobody asks.
    """
    meet = obstacle_contact_function(features)
    rub = rubbing_function(features)
    gravity = features.columns.places["gravity"] - features.columns.balloon_width

    @wp.func
    def leave_fixtures(
        t: Tables, spheres: Any, world: wp.int32, sphere: wp.int32, time: float, start: wp.vec3, motion: MotionState
    ):
        """Return a sphere out of obstacles, from which it turns by their restitution, see `stop_of`.

        Args:
            time: at the end of the step [s].
            start: where it was before the step.
        """
        radius = sphere_radius(t.spheres, world, sphere)
        fixtures = t.fixtures.solids.shape[0]
        pull = t.world_numbers[row_of_world(world, t.world_numbers.shape[0]), gravity]
        turns = wp.int32(0)
        while turns < MOST_TURNS:
            turns += 1
            end = motion.position
            for fixture in range(fixtures):
                met = meet(t, world, fixture, time, start, motion.position, radius)
                if wp.length_sq(met.normal) > 0.0:
                    if wp.static(note is not None):
                        note(spheres, world, BESIDE_OBSTACLE, sphere, fixture, motion, motion)
                    row = row_of_world(world, t.fixtures.restitutions.shape[0])
                    restitution = t.fixtures.restitutions[row, fixture]
                    coming = -wp.dot(motion.velocity - met.moving, met.normal)
                    depth = wp.dot(met.let - motion.position, met.normal)
                    before = coming - t.step_seconds * pull * wp.dot(met.normal, t.up)
                    stopped = stop_of(coming, depth, before, restitution, t.step_seconds)
                    motion.position = met.let + wp.max(t.step_seconds * stopped - depth, 0.0) * met.normal
                    motion.velocity += stopped * met.normal
                    friction = friction_between(t, world, number_of_sphere(t, sphere), number_of_obstacle(fixture))
                    left = met.part * t.step_seconds
                    motion = rub(t, world, sphere, motion, met.moving, met.normal, stopped, friction, left)
            if fixtures == 1 or is_settled(start, end, motion.position):
                turns = MOST_TURNS
            elif wp.static(not features.fixtures_move):
                if turns == MOST_TURNS:
                    if wp.static(note is not None):
                        note(spheres, world, STUCK, sphere, sphere, motion, motion)
                    motion.position = start
        return motion

    return leave_fixtures


@cache
def rolling_function(features: Features, note: Any = None) -> Any:
    """Return the function that moves a sphere under gravity, beside the ground and obstacles.

    Args:
        note: as in `leaving_function`.
    """
    leave_fixtures = leaving_function(features, note) if features.fixtures else None
    rub_on_ground = ground_rubbing_function(features)

    @wp.func
    def roll(
        t: Tables, spheres: Any, world: wp.int32, sphere: wp.int32, time: float, motion: MotionState, pushed: wp.vec3,
        around: wp.vec3,
    ):  # fmt: skip
        """Return a sphere's course after a step.

        Args:
            time: Time at the end of the step [s].
            pushed: Acceleration by particles, by the paper's rule [m/s^2].
            around: Gravity, the ground's height and its restitution.
        """
        radius = sphere_radius(t.spheres, world, sphere)
        start = motion.position
        if wp.static(note is not None):
            note(spheres, world, ROLLS, sphere, sphere, motion, motion)
        position, velocity, stopped = fall(
            motion.position, motion.velocity, pushed, radius, around[0], t.up, around[1], around[2], t.step_seconds
        )
        motion = rub_on_ground(t, world, sphere, motion_state_of(position, velocity, motion.spin), stopped)
        if wp.static(features.fixtures):
            motion = leave_fixtures(t, spheres, world, sphere, time, start, motion)
        return motion

    return roll


MOST_SWEEPS = wp.constant(24)
"""Largest number of sweeps over all pairs in a step; a stack of two usually needs one or two"""
SETTLED = wp.constant(1.0e-6)
"""Displacement below which a sphere counts as at rest, over its radius"""


@cache
def beside_function(features: Features, note: Any = None) -> Any:
    """Make the function that puts a sphere that another has moved out of the ground and obstacles.

    Args:
        note: as in `leaving_function`.
    """
    leave_fixtures = leaving_function(features, note) if features.fixtures else None
    rub_on_ground = ground_rubbing_function(features)
    height, ground_restitution = (
        features.columns.places[name] - features.columns.balloon_width
        for name in ("ground_height", "ground_restitution")
    )

    @wp.func
    def put_beside(t: Tables, spheres: Any, world: wp.int32, time: float, sphere: wp.int32, motion: MotionState):
        """Move a sphere that another has pushed out of the ground and obstacles."""
        radius = sphere_radius(t.spheres, world, sphere)
        if wp.static(features.ground):
            row = row_of_world(world, t.world_numbers.shape[0])
            depth = t.world_numbers[row, height] + radius - wp.dot(motion.position, t.up)
            if depth > 0.0:
                if wp.static(note is not None):
                    note(spheres, world, BESIDE_GROUND, sphere, sphere, motion, motion)
                restitution = t.world_numbers[row, ground_restitution]
                coming = -wp.dot(motion.velocity, t.up)
                stopped = stop_of(coming, t.step_seconds * coming, coming, restitution, t.step_seconds)
                motion.position += depth * t.up
                motion.velocity += stopped * t.up
                motion = rub_on_ground(t, world, sphere, motion, stopped)
        if wp.static(features.fixtures):
            motion = leave_fixtures(t, spheres, world, sphere, time, spheres.sphere_starts[world, sphere], motion)
        put_motion(spheres, world, sphere, motion, wp.static(features.spheres_rub))

    return put_beside


@cache
def pair_rubbing_function(features: Features) -> Any:
    """Make the function by which two spheres that meet rub on each other."""

    @wp.func
    def rub_pair(
        t: Tables,
        world: wp.int32,
        first: wp.int32,
        second: wp.int32,
        mine: MotionState,
        other: MotionState,
        normal: wp.vec3,
        pushed: float,
        seconds: float,
    ):
        """Return the courses of two spheres after friction on each other, for the rest of the step.

        Args:
            normal: from the first to the second.
            pushed: the impulse along it [N s].
        """
        if wp.static(features.spheres_rub):
            mass = sphere_mass(t.spheres, world, first)
            other_mass = sphere_mass(t.spheres, world, second)
            radius = sphere_radius(t.spheres, world, first)
            other_radius = sphere_radius(t.spheres, world, second)
            arm = radius * normal
            other_arm = -other_radius * normal
            beside = other.velocity + wp.cross(other.spin, other_arm) - mine.velocity - wp.cross(mine.spin, arm)
            inverse_mass = inverse_mass_of_ball(mass, radius, arm) + inverse_mass_of_ball(
                other_mass, other_radius, other_arm
            )
            friction = friction_between(t, world, number_of_sphere(t, first), number_of_sphere(t, second))
            rub = friction_impulse(beside, normal, inverse_mass, friction * pushed)
            mine.position -= (seconds / mass) * rub
            mine.velocity -= rub / mass
            mine.spin += spin_by(mass, radius, -wp.cross(arm, rub))
            other.position += (seconds / other_mass) * rub
            other.velocity += rub / other_mass
            other.spin += spin_by(other_mass, other_radius, wp.cross(other_arm, rub))
        return mine, other

    return rub_pair


@wp.func
def may_meet(t: Tables, spheres: Any, world: wp.int32, first: wp.int32, second: wp.int32):
    """Return whether two spheres are so near that they may collide in the step."""
    start = spheres.sphere_starts[world, first]
    other_start = spheres.sphere_starts[world, second]
    way = wp.length(spheres.sphere_positions[world, first] - start)
    way += wp.length(spheres.sphere_positions[world, second] - other_start)
    reach = sphere_radius(t.spheres, world, first) + sphere_radius(t.spheres, world, second)
    return wp.length(other_start - start) <= 1.001 * (reach + way)


@cache
def colliding_function(features: Features, note: Any = None) -> Any:
    """Make the function that lets the spheres of a world meet once all have moved: by one thread, in the same order.

    Args:
        note: as in `leaving_function`.
    """
    gravity = features.columns.places["gravity"] - features.columns.balloon_width
    rub_pair, put_beside = pair_rubbing_function(features), beside_function(features, note)

    @wp.func
    def meet_pair(t: Tables, spheres: Any, world: wp.int32, time: float, first: wp.int32, second: wp.int32):
        """Resolve the collision of two spheres, and return whether it has moved them."""
        reach = sphere_radius(t.spheres, world, first) + sphere_radius(t.spheres, world, second)
        mine = motion_at(spheres, world, first)
        other = motion_at(spheres, world, second)
        before = spheres.sphere_starts[world, second] - spheres.sphere_starts[world, first]
        shift, gain, part = collision(
            before, other.position - mine.position - before, other.velocity - mine.velocity, reach,
            mean_restitution(
                sphere_restitution(t.spheres, world, first), sphere_restitution(t.spheres, world, second)
            ),
            t.world_numbers[row_of_world(world, t.world_numbers.shape[0]), gravity], t.up, t.step_seconds,
        )  # fmt: skip
        moved = wp.length(shift) + t.step_seconds * wp.length(gain) > SETTLED * reach
        if moved:
            if wp.static(note is not None):
                note(spheres, world, MEETS, first, second, mine, other)
            mass = sphere_mass(t.spheres, world, first)
            other_mass = sphere_mass(t.spheres, world, second)
            share = share_of(mass, other_mass)
            others = share_of(other_mass, mass)
            mine.position -= share * shift
            mine.velocity -= share * gain
            other.position += others * shift
            other.velocity += others * gain
            if wp.length_sq(gain) > 0.0:
                mine, other = rub_pair(
                    t, world, first, second, mine, other, wp.normalize(gain), mass * share * wp.length(gain),
                    (1.0 - part) * t.step_seconds,
                )  # fmt: skip
            put_beside(t, spheres, world, time, first, mine)
            put_beside(t, spheres, world, time, second, other)
        return moved

    @wp.func
    def collide(t: Tables, spheres: Any, world: wp.int32, end: float):
        """Resolve collisions of spheres at the end of a step [s]; a sphere of zero radius is absent."""
        count = t.spheres.numbers.shape[1]
        moving = bool(True)
        sweep = wp.int32(0)
        while moving and sweep < MOST_SWEEPS:
            moving = bool(False)
            for second in range(1, count):
                for first in range(second):
                    smallest = wp.min(sphere_radius(t.spheres, world, first), sphere_radius(t.spheres, world, second))
                    if smallest > 0.0:
                        moved = meet_pair(t, spheres, world, end, first, second)
                        moving = moving or moved
            sweep += 1

    return collide


@wp.struct
class Ball:
    """A sphere after a step without contact."""

    center: wp.vec3
    velocity: wp.vec3
    radius: float
    mass: float
    sinking: float  # by how much it comes too fast to the ground, see `laws.contact`
    spin: wp.vec3  # where it has friction [rad/s]
    ground_friction: float  # between it and the ground, likewise


@cache
def ball_function(features: Features) -> Any:
    """Return the function that reads a sphere."""
    height = features.columns.places["ground_height"] - features.columns.balloon_width

    @wp.func
    def ball_at(t: Tables, spheres: Any, world: wp.int32, sphere: wp.int32):
        ball = Ball()
        if wp.static(features.spheres_rub):
            ball.spin = spheres.sphere_spins[world, sphere]
            ball.ground_friction = friction_between(t, world, number_of_sphere(t, sphere), GROUND)
        center, velocity, radius = sphere_at(t, spheres, world, sphere)
        ball.center = center
        ball.velocity = velocity
        ball.radius = radius
        ball.mass = sphere_mass(t.spheres, world, sphere)
        ground = t.world_numbers[row_of_world(world, t.world_numbers.shape[0]), height]
        ball.sinking = sinking_of_sphere(center, velocity, radius, t.up, ground, t.step_seconds)
        return ball

    return ball_at


@wp.func
def is_near_sphere(
    t: Tables, center: wp.vec3, sphere_velocity: wp.vec3, radius: float, point: wp.vec3, velocity: wp.vec3
):
    """Return whether a particle may have touched a sphere in this step."""
    displacement = t.step_seconds * (velocity - sphere_velocity)
    return comes_near(point - center - displacement, displacement, radius)


@wp.func
def press_on_ball(t: Tables, ball: Ball, change: wp.vec3, mass: float, point: wp.vec3, velocity: wp.vec3):
    """Return a particle's share of the load on a sphere with a given velocity change."""
    displacement = t.step_seconds * (velocity - ball.velocity)
    outward, excess, out = meet_sphere(
        point - ball.center - displacement, displacement, ball.radius, t.up, t.step_seconds
    )
    return press_of_particle(mass, outward, excess, out, change)


@wp.func
def change_of_ball(t: Tables, ball: Ball, press: Press, last: wp.vec3):
    """Return the change of a sphere's velocity [m/s].

    The pressing particles are those of the last estimate of the change.
    """
    return change_of_body(press, ball.mass, t.up, ball.sinking, last)


@wp.func
def response_to_ball(
    t: Tables, ball: Ball, last: wp.vec3, change: wp.vec3, shift: wp.vec3, point: wp.vec3, velocity: wp.vec3
):
    """Return a particle's point and velocity after the contact.

    Args:
        last: the change of the sphere's velocity before it was settled, which says who is pressed.
        shift: how far the sphere is moved out of overlaps.
    """
    displacement = t.step_seconds * (velocity - ball.velocity)
    outward, excess, out = meet_sphere(
        point - ball.center - displacement, displacement, ball.radius, t.up, t.step_seconds
    )
    if is_pressed(outward, excess, last):
        gain = gain_of_particle(outward, excess, change)
        velocity += gain
        point += t.step_seconds * gain
    if out > 0.0:
        point += gain_of_particle(outward, out, shift)
    return point, velocity


@wp.func
def rub_on_ball(
    t: Tables,
    ball: Ball,
    press: Press,
    last: wp.vec3,
    change: wp.vec3,
    mass: float,
    friction: float,
    point: wp.vec3,
    velocity: wp.vec3,
):
    """Return friction's impulse on a pressed particle [N s], and its torque about the sphere's center [N m s].

    Args:
        press: of the sphere.
        last: as in `response_to_ball`, as is the next.
        friction: Coulomb's coefficient of both.
        point: of the particle, before its answer.
    """
    displacement = t.step_seconds * (velocity - ball.velocity)
    arm = point - ball.center - displacement
    outward, excess, _out = meet_sphere(arm, displacement, ball.radius, t.up, t.step_seconds)
    rub = wp.vec3()
    if is_pressed(outward, excess, last):
        gain = gain_of_particle(outward, excess, change)
        beside = velocity + gain - ball.velocity - change - wp.cross(ball.spin, arm)
        share = 1.0 / (1.0 + mass_in(press, PRESSED) * inverse_mass_of_ball(ball.mass, ball.radius, arm))
        rub = rub_on(beside, mass * gain, mass, share, friction)
    return wp.spatial_vector(rub, wp.cross(arm, rub))


@wp.func
def rubbed_point(t: Tables, rub: wp.spatial_vector, mass: float, point: wp.vec3, velocity: wp.vec3):
    """Return a particle's point and velocity after its response, once friction has acted."""
    gain = wp.spatial_top(rub) / mass
    return point + t.step_seconds * gain, velocity + gain


@wp.func
def rubbed_ball(
    t: Tables, ball: Ball, press: Press, change: wp.vec3, center: wp.vec3, velocity: wp.vec3, rub: wp.spatial_vector
):
    """Return the center, velocity and spin of a sphere after its response, with friction on particles and the ground.

    Particles press it to the ground.

    Args:
        press: As in `rub_on_ball`, as is the next.
        rub: Friction on all particles.
    """
    gain = -wp.spatial_top(rub) / ball.mass
    spin = ball.spin - spin_by(ball.mass, ball.radius, wp.spatial_bottom(rub))
    if is_pressed(-t.up, ball.sinking, change):
        stopped = push_of_ground(press, ball.mass, t.up, change) / ball.mass
        braked, more = rubbed(velocity + gain, spin, wp.vec3(), t.up, stopped, ball.radius, ball.ground_friction)
        gain += braked
        spin += more
    return center + t.step_seconds * gain, velocity + gain, spin


@wp.func
def response_of_ball(t: Tables, ball: Ball, change: wp.vec3, shift: wp.vec3):
    """Return the sphere's center, velocity, and the force that has changed it [N]."""
    center = ball.center + t.step_seconds * change + shift
    return center, ball.velocity + change, (ball.mass / t.step_seconds) * change
