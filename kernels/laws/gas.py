"""Sealed gas: its pressure, how it comes and goes, and the air that moves along with a balloon.

Two numbers describe the sealed gas, its amount n [mol] and its *free volume* V_0 [m^3]: the volume that it would take
at one atmosphere p_0 by an adiabatic change. The free volume stands for the entropy, is conserved whatever becomes of
balloon and air, and adds up where gases mix. At the volume V the pressure is p_0 (V_0 / V)^gamma; so it is as warm as T
= p V / (n R). With gamma = 1 heat passes freely: the gas is as warm as the air, V_0 = n R T_air / p_0.

The *area vector* of a particle is the gradient of its balloon's volume with respect to its place [m^2], so that a
pressure p pushes it by p times that: net force and torque on a closed mesh vanish. The volume is that of faces as fans
around their centers; it is homogeneous of degree three in the places, so that it is a third of the sum of x . a.

A given pressure below that outside: the balloon is crushed flat, and stays so. Water above a balloon, or a pressure
below the air's, takes its volume for as long as there is any. Then its walls lie on each other, and what the one bears
the other holds: a skin whose volume is used up bears no further pressure.

Added mass is that of air around a balloon, which moves along with it. A body that is accelerated in a fluid pushes that
aside, and so sets it going: as if a part c of the displaced fluid were fixed to it, c = 1/2 for a sphere (Lamb,
*Hydrodynamics*, section 92). It has inertia, and no weight.

All particles bear it in proportion to their mass. For the balloon as a whole that is exact. Where its surface swings in
n waves, a sphere's air has rho R / (n + 1) for each square meter along the normal, and here there is rho R / 6: half of
it for n = 2, just that for n = 5; where it breathes, a sixth of the rho R of air that would not give.
"""

from typing import Any

import warp as wp

from balloon_warp.kernels.algebra import dot_product, scaled, times
from balloon_warp.kernels.lanes import LANE_COUNT, Five, Lanes, five
from balloon_warp.kernels.laws.air import AIR, ALIKE, air_of_height, molar_volume
from balloon_warp.kernels.laws.law import Parameter
from balloon_warp.kernels.laws.outer import EVENED, GRAVITY

COLLAPSING = wp.constant(0.5)
"""Fraction of a balloon's volume that remains after a step, below which the step is not first-order accurate"""
EMPTY = wp.constant(0.02)
"""Fraction of the mesh's volume that stays in a flat balloon, which no pump or opening takes out"""
EMPTIEST = wp.constant(1.0e-6)
"""Least volume fraction"""


@wp.func
def end_of_collapse(volume: float, held: float, air_pressure: float):
    """Return the volume at the end of a step [m^3] of a gas that would lose most of it in the step.

    There the pressure is p_a (V_a / x - 1) at the volume x of the end, V_a that at the air's pressure, and K the rise
    of the volume in the step with a pressure [m^3/Pa]: x = B + K p_a (V_a / x - 1). The larger root is never below 0,
    whatever is in there.

    Args:
        volume: B, as it would be at the end without any pressure [m^3].
        held: K p_a V_a [m^6].
        air_pressure: K p_a [m^3].
    """
    half = 0.5 * (volume - air_pressure)
    root = wp.sqrt(half * half + held)
    if half > 0.0:
        return half + root
    return held / wp.max(root - half, 1.0e-30)  # the same, to the last digit


@wp.func
def amount_when_flat(mesh_volume: float, air: wp.vec3):
    """Return the amount of gas in a flat balloon [mol], in air of a pressure and temperature."""
    return EMPTY * wp.max(mesh_volume, 0.0) / molar_volume(air[0], air[1])


HELIUM_MOLAR_MASS = 0.0040026
"""Molar mass of helium [kg/mol]"""
STANDARD_PRESSURE = 101325.0
"""Standard pressure p_0, one atmosphere [Pa]"""
THINNEST = 1.0e-3
"""Largest drop of a pressure in one step, as the remaining fraction, which bounds the response"""
PARAMETERS = (
    Parameter(
        "gamma",
        "1",
        1.0,
        least=1.0,
        most=10.0,
        path="inflation.gamma",
        meaning="Polytropic exponent of a sealed gas, p V^gamma constant: 1 isothermal, 1.4 adiabatic air, 1.667 "
        "adiabatic helium",
    ),
    Parameter(
        "breathing_damping",
        "1",
        1.0,
        least=0.0,
        most=1.0,
        path="inflation.breathing_damping",
        meaning="Numerical damping of the breathing mode, the quick oscillation of a gas balloon's volume: 1 "
        "backward Euler, 0 none by the trapezoidal rule, so that balloons breathe on",
    ),
    Parameter("molar_mass", "kg/mol", HELIUM_MOLAR_MASS, least=0.0, path="inflation.molar_mass", meaning="Molar mass"),
    EVENED,
    *AIR,
    GRAVITY,
)
Swelling = Five
"""Moments of a balloon's swelling, summed over its particles: see the numbers below."""
VOLUME = wp.constant(0)  # [m^3]
RESPONSE = wp.constant(1)  # to a pressure in a step: sum h |a|^2 / m [m^3/s/Pa], a the area vectors, along obstacles
RATE = wp.constant(2)  # sum a . v [m^3/s], v the velocities at the end of the step, without pressure
HEIGHT = wp.constant(3)  # of the center of mass [m]
RESPONSE_HEIGHT = wp.constant(4)  # sum h |a|^2 height / m [m^4/s/Pa]


@wp.func
def free_along(area_vector: Any, normal: Any):
    """Return the part of an area vector that a particle can follow beside an obstacle of this normal; zero if none.

    The particle is pressed against the obstacle.
    """
    return area_vector - scaled(normal, dot_product(area_vector, normal))


@wp.func
def rate_beside_obstacles(area_vector: Any, free: Any, velocity: Any, gain: Any, push: Any):
    """Return the rate of swelling at a particle without pressure [m^3/s], beside obstacles.

    They take some of the rate that the old pressure would give. Where they take none, no bit changes.

    Args:
        free: the part of the area vector that it can follow, see `free_along`.
        velocity: without pressure, with the change by obstacles that the old pressure led to [m/s].
        push: the old pressure [Pa].
    """
    lost = dot_product(area_vector, area_vector) - dot_product(free, free)
    return dot_product(area_vector, velocity) + times(push, times(gain, lost))


@wp.func
def swelling_of_particle(arm: Any, area_vector: Any, free: Any, rate: Any, gain: Any, share: Any, height: Any):
    """Return a particle's contribution to its balloon's swelling.

    Args:
        arm: from a point of the balloon's own, about which its volume is taken, which keeps float32's digits.
        free: the part of the area vector that it can follow, see `free_along`.
        rate: the area vector times the velocity at which it will move in this step without pressure, less
            `memory_of_rate` of that before the step [m^3/s].
        gain: h / m, the velocity that a force gives in a step [m/s/N]; 0 if it is fixed.
        share: of the balloon's mass.
    """
    volume = dot_product(arm, area_vector) / 3.0
    response = times(gain, dot_product(free, free))
    return five(volume, response, rate, times(share, height), times(response, height))


@wp.func
def weight_of_end(breathing_damping: float):
    """Return the weight w of pressures over a step, see `gas_load`: 1 backward Euler, 1/4 the trapezoidal rule."""
    return 0.25 + 0.75 * breathing_damping


@wp.func
def memory_of_rate(breathing_damping: float):
    """Return the weight k of the old rate of swelling relative to the new one, see `gas_load`.

    It is 0 in backward Euler, 1 in the trapezoidal rule.
    """
    return (1.0 - breathing_damping) / (1.0 + 3.0 * breathing_damping)


@wp.func
def memory_of_rate(breathing_damping: Lanes):  # noqa: F811 - an overload
    """Return the same in each lane."""
    memories = Lanes()
    for lane in range(LANE_COUNT):
        memories[lane] = memory_of_rate(breathing_damping[lane])
    return memories


@wp.func
def gas_pressure(air_pressure: float, free_volume: float, volume: float, gamma: float):
    """Return the gauge pressure of a gas, p_0 (V_0 / V)^gamma - p_a [Pa]; with gamma = 1, n R T / V - p_a."""
    squeezed = free_volume / volume
    if gamma != 1.0:  # or else a power is rounded, and later
        squeezed = wp.pow(squeezed, gamma)
    return STANDARD_PRESSURE * squeezed - air_pressure


@wp.func
def volume_at(free_volume: float, pressure: float, gamma: float):
    """Return the volume of a gas, or of a mole of it, at an absolute pressure, V_0 (p_0 / p)^(1 / gamma)."""
    return free_volume * wp.pow(STANDARD_PRESSURE / pressure, 1.0 / gamma)


@wp.func
def free_volume_of(volume: float, pressure: float, gamma: float, warmth: float):
    """Return the free volume of a gas [m^3]; `warmth` is the air's temperature over that at height 0."""
    free_volume = volume * wp.pow(pressure / STANDARD_PRESSURE, 1.0 / gamma)
    return wp.where(gamma == 1.0, free_volume / warmth, free_volume)


@wp.func
def gas_energy(air_pressure: float, free_volume: float, volume: float, gamma: float):
    """Return the energy of a gas and the air around it [J], 0 in equilibrium.

    Its negative slope by the volume is the pressure above the air's.
    """
    balanced = volume_at(free_volume, air_pressure, gamma)
    ratio = balanced / volume
    inside = balanced * wp.log(ratio)
    if gamma != 1.0:
        inside = balanced * (wp.pow(ratio, gamma - 1.0) - 1.0) / (gamma - 1.0)
    return air_pressure * (inside + volume - balanced)


@wp.func
def free_volume_there(free_volume: float, gamma: float, warmth: float):
    """Return the free volume of a gas at the air's temperature [m^3], where it depends on that."""
    return wp.where(gamma == 1.0, free_volume * warmth, free_volume)


@wp.func
def max_pressure(bound: float, mass: float, step_seconds: float):
    """Largest gauge pressure at which a step is stable against rotation of the skin [Pa].

    Args:
        bound: of the balloon's shape [1/m], see `balloon_warp.model.spectrum`.
        mass: of the balloon [kg].
        step_seconds: [s].
    """
    return bound * mass / (step_seconds * step_seconds)


@wp.func
def gas_load(
    swelling: Swelling,
    gas: wp.vec2,
    step_seconds: float,
    gamma: float,
    breathing_damping: float,
    molar_mass: float,
    air_pressure: float,
    air_temperature: float,
    air_density: float,
    air_lapse: float,
    gravity: float,
):
    """Return the gauge pressure of a gas [Pa], its gradient with height [Pa/m], and how both rise with more gas.

    The pressure is that at the center of mass, at height 0; how it and its rise would grow is for each m^3 of free
    volume. `gas` is its amount [mol] and free volume [m^3].

    Where the gas is stiff, the step is too long for the pressure p(V) of its beginning. The acting pressure is a mean
    of those at its end, its beginning and that of the step before, to first order in the volume:

        P = p(V) - w s h (r - k r_before),  r = r_free + G P,

    s = -dp/dV, r the rate of swelling in the step, r_free that without the gas, and G the response. Solved for P, it is
    stable at any step that the springs allow, p(V) at rest whatever the step, since r counts the other forces and
    obstacles, and p(V) for h -> 0. With w = 1, k = 0 it is backward Euler in the one direction in which the gas is
    stiff. With w = 1/4, k = 1 it is the mean (p_before + 2 p + p_after) / 4, the trapezoidal rule in that direction
    (Newmark's beta = 1/4), which neither damps nor drives: a balloon that breathes at the rate omega does so at
    (2 / h) atan(omega h / 2). Forward Euler takes w = 1, k = 0, and keeps that mode as it is.

    The air's pressure falls with height, and the gas's less: that is buoyancy and the gas's weight. The area vectors
    times height add up to V up exactly.
    """
    air = air_of_height(swelling[HEIGHT], air_pressure, air_temperature, air_density, air_lapse, gravity)
    there = gas[1]
    if air_lapse > ALIKE:  # or else the air is as warm at all heights
        there = free_volume_there(gas[1], gamma, air[1] / air_temperature)
    least = THINNEST * there * wp.min(STANDARD_PRESSURE / air[0], 1.0)
    volume = wp.max(swelling[VOLUME], wp.max(least, 1.0e-20))
    explicit = gas_pressure(air[0], there, volume, gamma)
    stiffness = gamma * (air[0] + explicit) / volume
    rise = (air[2] - gas[0] * molar_mass / volume) * gravity
    by_rise = rise * (swelling[RESPONSE_HEIGHT] - swelling[HEIGHT] * swelling[RESPONSE])
    rate = swelling[RATE] + by_rise
    pull = weight_of_end(breathing_damping) * stiffness * step_seconds
    yielding = 1.0 + pull * swelling[RESPONSE]
    pressure = (explicit - pull * rate) / yielding
    thin = THINNEST * wp.vec2(STANDARD_PRESSURE, volume)
    slope = gamma * wp.max(air[0] + explicit, thin[0]) / wp.max(there, thin[1]) / yielding
    added = step_seconds * swelling[RESPONSE]
    without = swelling[VOLUME] + step_seconds * rate
    if added > 0.0 and without + added * pressure < COLLAPSING * volume:
        # so close to empty p(V) is no line
        full = added * air[0]
        held = full * volume_at(there, air[0], gamma)
        end = wp.max(end_of_collapse(without, held, full), EMPTIEST * volume)
        pressure = (end - without) / added
        slope = end * air[0] / (end * end + held)
    return wp.vec4(pressure, pressure - rise * swelling[HEIGHT], rise, slope)


@wp.func
def borne_load(load: wp.vec4, bound: float, step_seconds: float, mass: float):
    """Return the load of a gas, of a pressure no higher than the step bears.

    Along other motions than the swelling the pressure is explicit: a gas that is pressed flat would turn its skin
    inside out. It is as hard again when it has room.

    Args:
        load: see `gas_load`.
        bound: see `max_pressure`.
        step_seconds: [s].
        mass: of the balloon [kg].
    """
    excess = wp.max(load[0] - max_pressure(bound, mass, step_seconds), 0.0)
    return load - wp.vec4(excess, excess, 0.0, 0.0)


@wp.func
def throttled(molar_free_volume: float, pressure: float, pressure_beyond: float, gamma: float):
    """Free volume of a mole of gas beyond a valve [m^3/mol], v (p / p')^(1 - 1 / gamma), the pressures in full [Pa].

    A valve keeps the gas's enthalpy, and so its temperature; the entropy grows as the pressure falls (Cengel, Boles,
    *Thermodynamics*, "throttling valves" and "charging of a tank"). A tank that is filled so gains
    gamma R T / (gamma - 1) with each mole of the temperature T.
    """
    return molar_free_volume * wp.pow(pressure / wp.max(pressure_beyond, THINNEST * pressure), 1.0 - 1.0 / gamma)


@wp.func
def pumped_gas(
    gas: wp.vec2d,
    moles: float,
    least: float,
    pressure: float,
    gamma: float,
    air_temperature: float,
    temperature_here: float,
):
    """Return the amount [mol] and free volume [m^3] of a gas after an amount is pumped in, or if negative let out.

    Gas that enters has the air's temperature here, and goes through a valve to the `pressure` in there, in full [Pa];
    gas that leaves takes its part of the free volume along, as long as there is more than `least` [mol]. Where heat
    passes, that is told as at height 0, see `free_volume_there`.
    """
    amount = wp.max(gas[0] + wp.float64(moles), wp.min(gas[0], wp.float64(least)))
    free_volume = gas[1]
    if gamma == 1.0:
        free_volume = amount * wp.float64(molar_volume(STANDARD_PRESSURE, air_temperature))
    elif moles > 0.0:
        of_air = molar_volume(STANDARD_PRESSURE, temperature_here)
        free_volume += wp.float64(moles * throttled(of_air, STANDARD_PRESSURE, pressure, gamma))
    elif moles < 0.0:
        free_volume *= amount / wp.max(gas[0], wp.float64(1.0e-20))
    return wp.vec2d(amount, free_volume)


@wp.func
def molar_free_volume(gas: wp.vec2d):
    """Free volume of a mole [m^3/mol]."""
    return float(gas[1] / wp.max(gas[0], wp.float64(1.0e-20)))


FLAT = wp.constant(0.1)
"""Fraction of the mesh's volume below which a liquid's pressure begins to meet itself through the skin"""
NO_INSIDE = -1.0
"""Marker: volume of a mesh that is open, or wound the other way around [m^3]"""


@wp.func
def given_load(
    swelling: Swelling,
    given: float,
    mesh_volume: float,
    step_seconds: float,
    water_level: float,
    water_density: float,
    gravity: float,
):
    """Return the gauge pressure in a balloon of a given one [Pa], that at height 0, and its gradient [Pa/m].

    It is the given one p, or else what keeps the volume from going below the least V_0, `EMPTY` of the mesh's, in the
    step h: with r the rate of swelling without pressure, and G the response, see `laws.gas`,

        V + h (r + G P) >= V_0,  P >= p.

    That takes from the skin's velocities no more than what shrinks it, by the shortest way in kinetic energy: as if its
    walls met and stuck, no energy is gained, however hard it is pressed and however long the step.

    On a flat skin in a liquid the walls press on each other as the liquid does on them, more below than above. So the
    gradient becomes the liquid's, from `FLAT` of the mesh's volume on: nothing is left that would swell one part of the
    skin by turning another inside out, and what it holds lifts no more.

    Args:
        swelling: without pressure.
        given: the given gauge pressure p [Pa].
        mesh_volume: `NO_INSIDE` if there is none to be used up [m^3].
    """
    pressure = given
    rise = float(0.0)
    least = EMPTY * mesh_volume
    added = step_seconds * swelling[RESPONSE]
    middle = swelling[HEIGHT]
    if mesh_volume >= 0.0 and added > 0.0:
        end = swelling[VOLUME] + step_seconds * swelling[RATE] + added * given
        pressure += wp.max(least - end, 0.0) / added
        middle = swelling[RESPONSE_HEIGHT] / swelling[RESPONSE]
        if middle < water_level:
            used = (FLAT * mesh_volume - swelling[VOLUME]) / wp.max(FLAT * mesh_volume - least, 1.0e-30)
            rise = -wp.clamp(used, 0.0, 1.0) * water_density * gravity
    at_ground = pressure - rise * middle
    return wp.vec4(at_ground + rise * swelling[HEIGHT], at_ground, rise, 0.0)


@wp.func
def tube_flow(conductance: float, flow: float, difference: float, softness: float, step_seconds: float):
    """Return the correction of a tube's flow [mol/s] that makes it conductance times the difference of pressures.

    These are the pressures at its ends [Pa] at the end of a step, where they fall by `softness` [Pa/mol] with all that
    flows.
    """
    return (conductance * difference - flow) / (1.0 + conductance * step_seconds * softness)


@wp.func
def flow_and_fall(
    flow: float, pressures: wp.vec2, slopes: wp.vec2, moles: wp.vec2, most: wp.vec2, conductance: float,
    step_seconds: float,
):  # fmt: skip
    """Return the corrected flow of a tube [mol/s], and the free volumes that the correction brings to its ends [m^3].

    Args:
        slopes: Rise of the pressure at each end with the free volume [Pa/m^3].
        moles: Free volumes of a mole at the ends [m^3/mol].
        most: Largest flows out of the ends [mol/s].
    """
    softness = moles[0] * slopes[0] + moles[1] * slopes[1]
    more = tube_flow(conductance, flow, pressures[0] - pressures[1], softness, step_seconds)
    more = wp.clamp(flow + more, -most[1], most[0]) - flow
    return wp.vec3(flow + more, -step_seconds * more * moles[0], step_seconds * more * moles[1])


@wp.func
def gas_through_tube(source: wp.vec2d, sink: wp.vec2d, moles: float, pressures: wp.vec2, gamma: float):
    """Return the amounts [mol] and free volumes [m^3] of two gases after an amount flows from one to the other.

    `pressures` are theirs, in full [Pa]. Gas that leaves takes its part of the free volume along, and is throttled.
    """
    moved = wp.min(wp.float64(moles), source[0])
    taken = molar_free_volume(source)
    brought = throttled(taken, pressures[0], pressures[1], gamma)
    left = wp.vec2d(source[0] - moved, wp.max(source[1] - moved * wp.float64(taken), wp.float64(0.0)))
    return left, sink + moved * wp.vec2d(wp.float64(1.0), wp.float64(brought))


ADDED_MASS = Parameter(
    "added_mass",
    "1",
    0.5,
    least=0.0,
    most=100.0,
    path="inflation.added_mass",
    meaning="Added mass coefficient of a gas balloon, as a fraction of the displaced air's mass: 0.5 for a "
    "sphere, 0 for none",
)


@wp.func
def volume_of_gas(pressure: float, free_volume: float, gamma: float, air_pressure: float):
    """Return the volume of a gas from its gauge pressure [m^3], for `gas_pressure`."""
    return volume_at(free_volume, wp.max(air_pressure + pressure, THINNEST * STANDARD_PRESSURE), gamma)


@wp.func
def air_along(
    height: float,
    pressure: float,
    free_volume: float,
    added_mass: float,
    gamma: float,
    air_pressure: float,
    air_temperature: float,
    air_density: float,
    air_lapse: float,
    gravity: float,
):
    """Return the mass of the air that moves along with a balloon at a height [kg]."""
    air = air_of_height(height, air_pressure, air_temperature, air_density, air_lapse, gravity)
    there = free_volume_there(free_volume, gamma, air[1] / air_temperature)
    return added_mass * air[2] * volume_of_gas(pressure, there, gamma, air[0])
