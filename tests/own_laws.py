"""Laws defined by the tests, in a module that workers can import."""

from typing import Any

import warp as wp

from balloon_warp import Parameter, face_law, particle_law, spring_law


@wp.func
def magnet(position: wp.vec3, mass: float, strength: float, pole: wp.vec3):
    """Return the force towards a pole, in proportion to mass and distance [N]."""
    return mass * strength * (pole - position)


@wp.func
def magnet_energy(position: wp.vec3, mass: float, strength: float, pole: wp.vec3):
    """Return the energy 1/2 mass strength distance^2 [J]."""
    return 0.5 * mass * strength * wp.length_sq(pole - position)


@wp.func
def hardening(squared_length: float, rest_length: float, stiffness: float, hardness: float):
    """Return the excess pull of a hardening spring over Hooke's [N/m]: its constant grows with the square of its strain
    e, up to (1 + hardness) times: F = k hardness L e^3 / (1 + e^2)."""
    length = wp.sqrt(squared_length)
    strain = length / rest_length - 1.0
    return stiffness * hardness * rest_length * strain * strain * strain / ((1.0 + strain * strain) * length)


@wp.func
def hardening_energy(squared_length: float, rest_length: float, stiffness: float, hardness: float):
    """Return the energy 1/2 k hardness L^2 (e^2 - log(1 + e^2)) [J]."""
    strain = wp.sqrt(squared_length) / rest_length - 1.0
    squared = strain * strain
    return 0.5 * stiffness * hardness * rest_length * rest_length * (squared - wp.log(1.0 + squared))


@wp.func
def gust(
    area_vector: wp.vec3,
    velocity: wp.vec3,
    time: float,
    gust_velocity: wp.vec3,
    gust_density: float,
    gust_seconds: float,
):
    """Return the force of a gust on a windward face [N]: 1/2 density u^2 of its area, u the approach speed."""
    strength = wp.sin(wp.pi * wp.min(time / gust_seconds, 1.0))
    flux = wp.min(wp.dot(strength * gust_velocity - velocity, area_vector), 0.0)
    return (-0.5 * gust_density * flux * flux / wp.max(wp.length_sq(area_vector), 1.0e-30)) * area_vector


def gust_bound(area: Any, velocity: Any, gust_velocity: Any, gust_density: Any) -> Any:
    """Return density A u [N s/m], the derivative of the force by u."""
    return gust_density * area * ((gust_velocity**2).sum(axis=-1) ** 0.5 + (velocity**2).sum(axis=-1) ** 0.5)


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
    energy=hardening_energy,
    neutral={"hardness": 0.0},
    stiffness=lambda stiffness, hardness: 1.125 * stiffness * hardness,  # its steepest is at a strain of root 3
)
GUST = face_law(
    gust,
    (
        Parameter("gust_velocity", "m/s", of="world", size=3),
        Parameter("gust_density", "kg/m^3", 1.2, least=0.0, of="world", meaning="of the air"),
        Parameter("gust_seconds", "s", 1.0, least=1.0e-3, of="world", meaning="how long it lasts"),
    ),
    neutral={"gust_density": 0.0},
    drag=gust_bound,
)


@wp.func
def repelling(squared_length: float, rest_length: float, repulsion: float):
    """Return the repulsion of a spring's ends [N/m]: F = -c L^8 d / |d|^8, with a pole where they coincide."""
    ratio = rest_length * rest_length / squared_length
    squared = ratio * ratio
    return -repulsion * squared * squared


REPELLING = spring_law(
    repelling,
    (Parameter("repulsion", "N/m", 0.0, least=0.0),),
    neutral={"repulsion": 0.0},
    stiffness=lambda repulsion: 100.0 * repulsion,
)
