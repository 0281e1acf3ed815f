"""Coulomb's coefficient of each pair of things, as the host has resolved it; how things are numbered."""

import warp as wp

from balloon_warp.kernels.tables import Tables, row_of_world

GROUND = wp.constant(0)
"""Number of the ground; then come obstacles, spheres, free bodies and balloons"""


@wp.func
def number_of_obstacle(obstacle: wp.int32):
    """Return the number of an obstacle among all things."""
    return 1 + obstacle


@wp.func
def number_of_sphere(t: Tables, sphere: wp.int32):
    """Return the number of a sphere among all things."""
    return 1 + t.fixtures.solids.shape[0] + sphere


@wp.func
def number_of_body(t: Tables, body: wp.int32):
    """Return the number of a body among all things."""
    return 1 + t.fixtures.solids.shape[0] + t.spheres.numbers.shape[1] + body


@wp.func
def number_of_balloon(t: Tables, balloon: wp.int32):
    """Return the number of a balloon among all things: balloons are the last."""
    return t.friction.shape[1] - t.balloon_numbers.shape[1] + balloon


@wp.func
def friction_between(t: Tables, world: wp.int32, first: wp.int32, second: wp.int32):
    """Return Coulomb's coefficient of two things."""
    return t.friction[row_of_world(world, t.friction.shape[0]), first, second]


@wp.func
def friction_on(t: Tables, world: wp.int32, balloon: wp.int32, thing: wp.int32):
    """Return Coulomb's coefficient of a balloon and a thing."""
    return friction_between(t, world, number_of_balloon(t, balloon), thing)


@wp.func
def friction_of_balloons(t: Tables, world: wp.int32, first: wp.int32, second: wp.int32):
    """Return Coulomb's coefficient of two balloons."""
    return friction_on(t, world, first, number_of_balloon(t, second))
