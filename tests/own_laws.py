"""Laws of the tests' own, in a module that workers find, too."""

import warp as wp

from balloon_warp import Parameter, particle_law, spring_law


@wp.func
def magnet(position: wp.vec3, mass: float, strength: float, pole: wp.vec3):
    """A force towards a pole, in proportion to mass and distance [N]."""
    return mass * strength * (pole - position)


@wp.func
def magnet_energy(position: wp.vec3, mass: float, strength: float, pole: wp.vec3):
    """1/2 mass strength distance^2 [J]"""
    return 0.5 * mass * strength * wp.length_sq(pole - position)


@wp.func
def hardening(squared_length: float, rest_length: float, stiffness: float, hardness: float):
    """What a spring is stiffer by, in proportion to its strain [N/m], up to twice its constant."""
    return wp.min(hardness * (wp.sqrt(squared_length) / rest_length - 1.0), 1.0) * stiffness


MAGNET = particle_law(
    magnet,
    (
        Parameter("strength", "1/s^2", 2.0, least=0.0, meaning="squared frequency about the pole"),
        Parameter("pole", "m", of="world", size=3),
    ),
    energy=magnet_energy,
    neutral={"strength": 0.0},
    stiffness=lambda mass, strength: mass * strength,
)
HARDENING = spring_law(
    hardening,
    (Parameter("hardness", "1", 0.0, least=0.0, most=10.0),),
    neutral={"hardness": 0.0},
    stiffness=lambda stiffness: 3.0 * stiffness,
)
