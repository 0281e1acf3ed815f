"""Sealed gas: its pressure, how a balloon swells under it, and what flows through tubes.

The *area vector* of a particle is the gradient of its balloon's volume with respect to its place [m^2], so that a
pressure p pushes it by p times that: net force and torque on a closed mesh vanish. The volume is that of faces as fans
around their centers; it is homogeneous of degree three in the places, so that it is a third of the sum of x . a.
"""

import warp as wp

from balloon_warp.kernels.laws.air import AIR, density_of_air, molar_volume
from balloon_warp.kernels.laws.body import GRAVITY
from balloon_warp.kernels.laws.law import Parameter

HELIUM_MOLAR_MASS = 0.0040026
"""[kg/mol]"""
PARAMETERS = (
    Parameter(
        "gamma",
        "1",
        1.0,
        least=1.0,
        most=10.0,
        path="inflation.gamma",
        meaning="p V^gamma of a gas stays as it is: 1 keeps it as warm, 1.4 keeps air's heat in, 1.667 helium's",
    ),
    Parameter("molar_mass", "kg/mol", HELIUM_MOLAR_MASS, least=0.0, path="inflation.molar_mass", meaning="of a gas"),
    *AIR,
    GRAVITY,
)

Swelling = wp.types.vector(length=5, dtype=wp.float32)
"""How a balloon swells, summed over its particles: see the numbers below."""
VOLUME = wp.constant(0)  # [m^3]
RESPONSE = wp.constant(1)  # sum |a|^2 / m [m^4/kg], a the area vectors, along obstacles
RATE = wp.constant(2)  # sum a . v [m^3/s], v the velocities at the end of the step, without pressure
HEIGHT = wp.constant(3)  # of the center of mass [m]
RESPONSE_HEIGHT = wp.constant(4)  # sum |a|^2 height / m [m^5/kg]


@wp.func
def swelling_of_particle(
    arm: wp.vec3,
    area_vector: wp.vec3,
    velocity: wp.vec3,
    normal: wp.vec3,
    mass: float,
    share: float,
    height: float,
    push: float,
    step_seconds: float,
):
    """A particle's part; without mass it is fixed.

    Args:
        arm: from a point of the balloon's own, about which its volume is taken, which keeps float32's digits.
        velocity: at which it will move in this step under the old pressure, beside obstacles [m/s].
        normal: of the obstacle that it is pressed against, along which it cannot follow the pressure; zero if none.
        share: of the balloon's mass.
        push: the old pressure [Pa], whose part in the velocity does not count.
    """
    volume = wp.dot(arm, area_vector) / 3.0
    free = area_vector - wp.dot(area_vector, normal) * normal
    response = wp.where(mass > 0.0, wp.length_sq(free) / mass, 0.0)
    rate = wp.dot(area_vector, velocity) - step_seconds * push * response
    return Swelling(volume, response, rate, share * height, response * height)


@wp.func
def gas_pressure(air_pressure: float, free_volume: float, volume: float, gamma: float):
    """Pressure of a gas above the air's [Pa]: p_a ((V_0 / V)^gamma - 1), V_0 what it would take in the air.

    For gamma = 1 this is n R T / V - p_a.
    """
    return air_pressure * (wp.pow(free_volume / volume, gamma) - 1.0)


@wp.func
def gas_energy(air_pressure: float, free_volume: float, volume: float, gamma: float):
    """Of a gas and the air around it [J], whose negative slope by the volume is the pressure above the air's; 0 where
    both are in balance."""
    ratio = free_volume / volume
    inside = -free_volume * wp.log(1.0 / ratio)
    if gamma != 1.0:
        inside = free_volume * (wp.pow(ratio, gamma - 1.0) - 1.0) / (gamma - 1.0)
    return air_pressure * (inside + volume - free_volume)


@wp.func
def gas_load(
    swelling: Swelling,
    amount: float,
    step_seconds: float,
    gamma: float,
    molar_mass: float,
    air_pressure: float,
    air_temperature: float,
    air_density: float,
    gravity: float,
):
    """Pressure of a gas above the air's at the center of mass [Pa], at height 0, and its rise with height [Pa/m].

    At the end of the step the volume will be V + h (r + h G p), r the rate and G the response, and the pressure, to
    first order, p(V) - s h (r + h G p) with s = -dp/dV. Solved for p, this is backward Euler in the one direction in
    which the gas is stiff: stable at any step that the springs allow, and the explicit p(V) for h -> 0. At rest it is
    p(V) whatever the step, since r counts the other forces, and obstacles. Forward Euler takes it, too, and keeps that
    mode bounded.

    The air's pressure falls with height, and the gas's less: that is buoyancy and the gas's weight. The area vectors
    times height add up to V up exactly.
    """
    free_volume = amount * molar_volume(air_pressure, air_temperature)
    volume = wp.max(swelling[VOLUME], wp.max(1.0e-3 * free_volume, 1.0e-20))
    explicit = gas_pressure(air_pressure, free_volume, volume, gamma)
    stiffness = gamma * (air_pressure + explicit) / volume
    outside = density_of_air(air_pressure, air_temperature, air_density)
    rise = (outside - amount * molar_mass / volume) * gravity
    by_rise = rise * (swelling[RESPONSE_HEIGHT] - swelling[HEIGHT] * swelling[RESPONSE])
    rate = swelling[RATE] + step_seconds * by_rise
    pressure = (explicit - stiffness * step_seconds * rate) / (
        1.0 + stiffness * step_seconds * step_seconds * swelling[RESPONSE]
    )
    return wp.vec3(pressure, pressure - rise * swelling[HEIGHT], rise)


@wp.func
def tube_flow(
    conductance: float,
    pressures: wp.vec2,
    amounts: wp.vec2,
    gamma: float,
    air_pressure: float,
    step_seconds: float,
):
    """Gas that a tube takes from its first balloon to its second in a step [mol].

    The flow evens out the pressures, and implicitly, since dp/dn = gamma p / n: no step is too long.
    """
    first = gamma * (air_pressure + pressures[0]) / wp.max(amounts[0], 1.0e-20)
    second = gamma * (air_pressure + pressures[1]) / wp.max(amounts[1], 1.0e-20)
    opening = conductance * step_seconds
    flow = opening * (pressures[0] - pressures[1]) / (1.0 + opening * (first + second))
    return wp.clamp(flow, -amounts[1], amounts[0])
