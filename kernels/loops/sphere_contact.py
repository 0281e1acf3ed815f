"""Exchange of momentum between spheres and particles, wherever both are kept, see `laws.impulse`.

A schedule sums `press_on_ball` over the particles until the sphere's change of velocity is settled, then has each
particle answer.
"""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.impulse import (
    PRESSED,
    Press,
    change_of_body,
    comes_near,
    gain_of_particle,
    is_pressed,
    mass_in,
    meet_sphere,
    press_of_particle,
    push_of_ground,
    sinking_of_sphere,
)
from balloon_warp.kernels.laws.rigid import rub_on
from balloon_warp.kernels.laws.sliding import ease_of_ball, rubbed, spin_by
from balloon_warp.kernels.loops.friction import GROUND, friction_between, number_of_sphere
from balloon_warp.kernels.spheres import sphere_at
from balloon_warp.kernels.tables import Tables, row_of_world, sphere_mass


@wp.struct
class Ball:
    """A sphere after a step without contact."""

    center: wp.vec3
    velocity: wp.vec3
    radius: float
    mass: float
    sinking: float  # by how much it comes too fast to the ground, see `laws.impulse`
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
    way = t.step_seconds * (velocity - sphere_velocity)
    return comes_near(point - center - way, way, radius)


@wp.func
def press_on_ball(t: Tables, ball: Ball, change: wp.vec3, mass: float, point: wp.vec3, velocity: wp.vec3):
    """Return a particle's share of the load on a sphere with a given velocity change."""
    way = t.step_seconds * (velocity - ball.velocity)
    outward, excess, out = meet_sphere(point - ball.center - way, way, ball.radius, t.up, t.step_seconds)
    return press_of_particle(mass, outward, excess, out, change)


@wp.func
def change_of_ball(t: Tables, ball: Ball, press: Press, last: wp.vec3):
    """Return the change of a sphere's velocity [m/s].

    The pressing particles are those of the last estimate of the change.
    """
    return change_of_body(press, ball.mass, t.up, ball.sinking, last)


@wp.func
def answer_to_ball(
    t: Tables, ball: Ball, last: wp.vec3, change: wp.vec3, shift: wp.vec3, point: wp.vec3, velocity: wp.vec3
):
    """Return a particle's point and velocity after the contact.

    Args:
        last: the change of the sphere's velocity before it was settled, which says who is pressed.
        shift: how far the sphere is moved out of overlaps.
    """
    way = t.step_seconds * (velocity - ball.velocity)
    outward, excess, out = meet_sphere(point - ball.center - way, way, ball.radius, t.up, t.step_seconds)
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
        last: as in `answer_to_ball`, as is the next.
        friction: Coulomb's coefficient of both.
        point: of the particle, before its answer.
    """
    way = t.step_seconds * (velocity - ball.velocity)
    arm = point - ball.center - way
    outward, excess, _out = meet_sphere(arm, way, ball.radius, t.up, t.step_seconds)
    rub = wp.vec3()
    if is_pressed(outward, excess, last):
        gain = gain_of_particle(outward, excess, change)
        beside = velocity + gain - ball.velocity - change - wp.cross(ball.spin, arm)
        share = 1.0 / (1.0 + mass_in(press, PRESSED) * ease_of_ball(ball.mass, ball.radius, arm))
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
def answer_of_ball(t: Tables, ball: Ball, change: wp.vec3, shift: wp.vec3):
    """Return the sphere's center, velocity, and the force that has changed it [N]."""
    center = ball.center + t.step_seconds * change + shift
    return center, ball.velocity + change, (ball.mass / t.step_seconds) * change
