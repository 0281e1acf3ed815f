"""Gravity, helium and damping (paper, "Particle Simulation")."""

import warp as wp

from balloon_warp.kernels.laws.law import TINY, Law, Parameter


@wp.func
def weight(mass: float, up: wp.vec3, gravity: float, helium: float):
    """Return the force of gravity [m/s^2] and helium's lift [N/kg] along the up axis [N]."""
    return (mass * (helium - gravity)) * up


@wp.func
def weight_energy(position: wp.vec3, mass: float, up: wp.vec3, gravity: float, helium: float):
    """Return the potential energy of the weight, -F . x [J]."""
    return -wp.dot(weight(mass, up, gravity, helium), position)


@wp.func
def damping(velocity: wp.vec3, mass_share: float, damping: float):
    """Return the drag against the velocity [N], of a particle's share of the balloon's damping [N s/m]."""
    return (-mass_share * damping) * velocity


MASS = Parameter(
    "mass", "kg", 0.1, least=TINY, path="mass", meaning="Mass of the whole balloon, shared equally by its particles"
)
GRAVITY = Parameter(
    "gravity", "m/s^2", 9.81, of="world", path="gravity", meaning="Gravitational acceleration against the up axis"
)
HELIUM = Parameter("helium", "m/s^2", path="helium", meaning="Buoyant acceleration; above `gravity` the balloon rises")
DAMPING_CONSTANT = Parameter(
    "damping",
    "N s/m",
    0.1,
    least=0.0,
    path="damping",
    meaning="Linear drag coefficient of the whole balloon, distributed like the mass",
)

WEIGHT = Law("particle", weight, (GRAVITY, HELIUM), energy=weight_energy)
DAMPING = Law(
    "particle",
    damping,
    (DAMPING_CONSTANT,),
    neutral={"damping": 0.0},
)
