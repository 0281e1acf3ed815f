"""Parameters of the contact of a particle with a triangle: whose masses, skins and friction they are."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.contact.triangles import side_of
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.loops.fixtures import friction_of_balloons
from balloon_warp.kernels.loops.meeting import Touching, skin_functions
from balloon_warp.kernels.memory import float_at, float_in, int_at
from balloon_warp.kernels.tables import Tables, row_of_world
from balloon_warp.kernels.working import Working


@wp.func
def ease_of_moving(t: Tables, mass_of_balloon: float, particle: wp.int32):
    """Return the inverse mass of a particle [1/kg], 0 if it is fixed."""
    mass = float_at(t.particles.mass_share, particle) * mass_of_balloon
    return wp.where(mass > 0.0, 1.0 / mass, 0.0)


@wp.func
def contacts_at(working: Working, world: wp.int32, particle: wp.int32, ease: float):
    """Return the contacts of a particle; none if it is fixed."""
    return wp.where(ease > 0.0, float_in(working.contacts, world, particle), 0.0)


@wp.func
def crowd_of_corners(working: Working, world: wp.int32, corners: wp.vec3i, masses: wp.vec4):
    """Return the contacts of the busiest corner of a triangle."""
    return wp.max(
        wp.max(contacts_at(working, world, corners[0], masses[1]), contacts_at(working, world, corners[1], masses[2])),
        contacts_at(working, world, corners[2], masses[3]),
    )


@cache
def mass_function(features: Features) -> Any:
    """Return the function for a balloon's mass."""
    mass_column = features.columns.places["mass"]

    @wp.func
    def mass_of(t: Tables, world: wp.int32, balloon: wp.int32):
        """Return a balloon's mass [kg]."""
        return t.balloon_numbers[row_of_world(world, t.balloon_numbers.shape[0]), balloon, mass_column]

    return mass_of


@cache
def pair_functions(features: Features) -> tuple[Any, Any, Any]:
    """Return the functions for the parameters of near pairs, for masses, and for the parameters of pushing pairs."""
    thickness_between, stiffness_between = skin_functions(features)
    mass_of = mass_function(features)

    @wp.func
    def beside(t: Tables, world: wp.int32, particle: wp.int32, candidate: wp.int32, corners: wp.vec3i):
        """Return the parameters that tell whether a pair touches."""
        inputs = Touching()
        inputs.side = side_of(candidate)
        balloon = int_at(t.particles.balloon, particle)
        other = int_at(t.particles.balloon, corners[0])
        inputs.thickness = thickness_between(t, world, balloon, other)
        inputs.step_seconds = t.step_seconds
        return inputs

    @wp.func
    def masses_of(t: Tables, world: wp.int32, particle: wp.int32, corners: wp.vec3i):
        """Return the inverse masses of a particle and of a triangle's corners [1/kg]."""
        its_mass = mass_of(t, world, int_at(t.particles.balloon, corners[0]))
        return wp.vec4(
            ease_of_moving(t, mass_of(t, world, int_at(t.particles.balloon, particle)), particle),
            ease_of_moving(t, its_mass, corners[0]),
            ease_of_moving(t, its_mass, corners[1]),
            ease_of_moving(t, its_mass, corners[2]),
        )

    @wp.func
    def pressed(
        t: Tables, working: Working, world: wp.int32, particle: wp.int32, corners: wp.vec3i, inputs: Touching,
        first: bool,
    ):  # fmt: skip
        """Return the parameters of a pair that pushes, of those that tell whether it touches."""
        balloon = int_at(t.particles.balloon, particle)
        other = int_at(t.particles.balloon, corners[0])
        pressing = Touching()
        pressing.side = inputs.side
        pressing.thickness = inputs.thickness
        pressing.step_seconds = inputs.step_seconds
        pressing.masses = inputs.masses
        pressing.stiffness = stiffness_between(t, world, balloon, other)
        pressing.friction = friction_of_balloons(t, world, balloon, other)
        pressing.first = first
        pressing.crowd = wp.max(
            contacts_at(working, world, particle, inputs.masses[0]) / float_at(t.touch.crowd, balloon),
            crowd_of_corners(working, world, corners, inputs.masses) / float_at(t.touch.crowd, other),
        )
        return pressing

    return beside, masses_of, pressed
