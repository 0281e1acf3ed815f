"""Gravity, helium, damping, and inflation: forces on a particle (paper, \"Particle Simulation\").

Inflation: a force on each particle along its *aim*, or along its area vector.

- Normal forces, the paper's: F = 100 k_normal (A_p / A_total) n (paper, "Particle Simulation"). A_p is the area of the
  incident face whose center is nearest to the particle, n the particle's Gouraud normal: the mean of the unit normals
  of its incident faces, normalized. The aim is (A_p / A_total) n, which the paper caches over a frame.
- A pressure, given or of a gas: F = p dV/dx, p times the particle's area vector.
"""

from typing import Any

import warp as wp

from balloon_warp.kernels.laws.law import TINY, Law, Parameter

NORMAL_FORCE = wp.constant(0)
PRESSURE = wp.constant(1)
GAS = wp.constant(2)
FAR = wp.constant(1.0e30)
"""Squared distance beyond all others [m^2]"""


@wp.func
def normal_push(k_normal: Any):
    """Force over the aim [N]."""
    return 100.0 * k_normal


@wp.func
def nearer_area(nearest: wp.vec2, point: wp.vec3, center: wp.vec3, area_vector: wp.vec3):
    """Return squared distance and area of the nearer of two faces, the nearest so far and this one."""
    squared_distance = wp.length_sq(center - point)
    return wp.where(squared_distance < nearest[0], wp.vec2(squared_distance, wp.length(area_vector)), nearest)


@wp.func
def vertex_normal_of(normal_sum: wp.vec3, nearest: wp.vec2):
    """Return A_p n from the sum of the unit normals around a particle, and its nearest face [m^2]."""
    return nearest[1] * wp.normalize(normal_sum)


@wp.func
def inflation_direction_of(vertex_normal: wp.vec3, total_area: float):
    """Return (A_p / A_total) n from A_p n."""
    return vertex_normal / wp.max(total_area, 1.0e-20)


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
