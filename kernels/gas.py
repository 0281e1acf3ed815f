"""Pressure, sealed gas and the air around: the laws.

The *area vector* of a particle is the gradient of its balloon's volume with respect to its place [m^2], so that a
pressure p pushes it by p times that: net force and torque on a closed mesh vanish. The volume is that of faces as fans
around their centers, V = 1/3 sum c . A.
"""

from typing import Any

import warp as wp

from balloon_warp.kernels.inflation import NORMAL_FORCE, face_area_vector, face_center, push
from balloon_warp.kernels.lanes_types import cross_product

# The kinds of inflation beside NORMAL_FORCE.
PRESSURE = wp.constant(1)
GAS = wp.constant(2)

GAS_CONSTANT = 8.314462618
"""[J/(mol K)]"""
DRY_AIR_MOLAR_MASS = 0.0289652
"""[kg/mol]"""

Swelling = wp.types.vector(length=5, dtype=wp.float32)
"""How a balloon swells, summed over its faces and particles: see the numbers below."""
VOLUME = wp.constant(0)  # [m^3]
RESPONSE = wp.constant(1)  # sum |a|^2 / m [m^4/kg], a the area vectors, along obstacles
RATE = wp.constant(2)  # sum a . v [m^3/s], v the velocities at the end of the step, without pressure
HEIGHT = wp.constant(3)  # of the center of mass [m]
RESPONSE_HEIGHT = wp.constant(4)  # sum |a|^2 height / m [m^5/kg]


@wp.func
def area_vector_at_corner(double_area: Any, chord: Any, arms: Any, corners: float):
    """What a face adds to the area vector of one of its corners [m^2].

    With c the face's center, A its area vector, n its corners, and b, d the corners before and after x, the gradient of
    1/3 c . A is (A / n + 1/2 (d - b) x c) / 3. Around a closed fan of faces the d - b add up to zero, so that c may be
    taken from any place, and from x float32 keeps its digits.

    Args:
        double_area: 2 A [m^2].
        chord: d - b [m].
        arms: from x to all corners, their sum [m]: n (c - x).
    """
    return (0.5 / (3.0 * corners)) * (double_area + cross_product(chord, arms))


@wp.func
def area_vector_in_face(
    points: Any,
    first: wp.int32,
    face_particles: wp.array[wp.int32],
    begin: wp.int32,
    end: wp.int32,
    particle: wp.int32,
    point: Any,
):
    """What a face adds to the area vector of a particle at `point`, be it one corner or several [m^2]."""
    before = points[first + face_particles[end - 1]] - point
    here = points[first + face_particles[begin]] - point
    arms = 0.0 * here
    double_area = 0.0 * here
    chord = 0.0 * here
    times = float(0.0)
    for corner in range(begin, end):
        after_corner = corner + 1
        if after_corner == end:
            after_corner = begin
        after = points[first + face_particles[after_corner]] - point
        if face_particles[corner] == particle:
            chord = chord + (after - before)
            times += 1.0
        arms = arms + here
        double_area = double_area + cross_product(here, after)
        before = here
        here = after
    return area_vector_at_corner(times * double_area, chord, arms, float(end - begin))


@wp.func
def area_vector_in_quad(before: wp.vec3, opposite: wp.vec3, after: wp.vec3):
    """What a quad adds to the area vector of a corner [m^2], from that corner to the others.

    `area_vector_in_face` with c = (b + o + d) / 4 and A = 1/2 o x (b - d): (d - b) x (b + d + 2 o) / 24.
    """
    return wp.cross(after - before, before + after + 2.0 * opposite) / 24.0


@wp.func
def cone_volume(center: wp.vec3, area_vector: wp.vec3):
    """Of the cone from the origin to a face [m^3]."""
    return wp.dot(center, area_vector) / 3.0


@wp.func
def face_volume(
    points: Any, first: wp.int32, face_particles: wp.array[wp.int32], begin: wp.int32, end: wp.int32, origin: wp.vec3
):
    """Of the cone from a point to a face [m^3]."""
    center = face_center(points, first, face_particles, begin, end)
    return cone_volume(center - origin, face_area_vector(points, first, face_particles, begin, end, center))


@wp.func
def swelling_of_particle(
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
        velocity: at which it will move in this step under the old pressure, beside obstacles [m/s].
        normal: of the obstacle that it is pressed against, along which it cannot follow the pressure; zero if none.
        share: of the balloon's mass.
        push: the old pressure [Pa], whose part in the velocity does not count.
    """
    free = area_vector - wp.dot(area_vector, normal) * normal
    response = wp.where(mass > 0.0, wp.length_sq(free) / mass, 0.0)
    rate = wp.dot(area_vector, velocity) - step_seconds * push * response
    return Swelling(0.0, response, rate, share * height, response * height)


@wp.func
def molar_volume(air_pressure: float, air_temperature: float):
    """Of any gas that is as cold and as dense as the air [m^3/mol]: R T / p."""
    return GAS_CONSTANT * air_temperature / air_pressure


@wp.func
def dry_air_density(air_pressure: float, air_temperature: float):
    """Of dry air as an ideal gas [kg/m^3]."""
    return DRY_AIR_MOLAR_MASS / molar_volume(air_pressure, air_temperature)


@wp.func
def gas_pressure(air_pressure: float, free_volume: float, volume: float, gamma: float):
    """Pressure of a gas above the air's [Pa]: p_a ((V_0 / V)^gamma - 1), V_0 what it would take in the air.

    For gamma = 1 this is n R T / V - p_a.
    """
    return air_pressure * (wp.pow(free_volume / volume, gamma) - 1.0)


@wp.func
def gas_load(
    swelling: Swelling,
    air_pressure: float,
    air_density: float,
    amount: float,
    volume_of_a_mole: float,
    molar_mass: float,
    gamma: float,
    gravity: float,
    step_seconds: float,
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
    free_volume = amount * volume_of_a_mole
    volume = wp.max(swelling[VOLUME], wp.max(1.0e-3 * free_volume, 1.0e-20))
    explicit = gas_pressure(air_pressure, free_volume, volume, gamma)
    stiffness = gamma * (air_pressure + explicit) / volume
    rise = (air_density - amount * molar_mass / volume) * gravity
    by_rise = rise * (swelling[RESPONSE_HEIGHT] - swelling[HEIGHT] * swelling[RESPONSE])
    rate = swelling[RATE] + step_seconds * by_rise
    pressure = (explicit - stiffness * step_seconds * rate) / (
        1.0 + stiffness * step_seconds * step_seconds * swelling[RESPONSE]
    )
    return wp.vec3(pressure, pressure - rise * swelling[HEIGHT], rise)


@wp.func
def push_of_kind(kind: wp.int32, k_normal: float, load: wp.vec2, height: float):
    """Force over a particle's aim [N or Pa] by the kind of inflation; the load is the pressure at height 0 and its
    rise."""
    if kind == NORMAL_FORCE:
        return push(k_normal)
    return load[0] + load[1] * height


@wp.func
def inflation_of_kind(kind: wp.int32, k_normal: float, load: wp.vec2, height: float, aim: wp.vec3):
    """Force on a particle [N] by the kind of inflation."""
    return push_of_kind(kind, k_normal, load, height) * aim


@wp.func
def drag_pressure(air_density: float, coefficient: float, flux: float, squared_area: float):
    """Force of the air on a particle over its area vector [Pa]: -1/2 density C_d u_n |u_n|.

    Args:
        flux: u . a [m^3/s], the particle's velocity relative to the wind times its area vector.
        squared_area: |a|^2 [m^4].
    """
    return -0.5 * air_density * coefficient * flux * wp.abs(flux) / wp.max(squared_area, 1.0e-30)


@wp.func
def air_drag(air_density: float, coefficient: float, wind: wp.vec3, area_vector: wp.vec3, velocity: wp.vec3):
    """Force of the air on a particle [N]: 1/2 density C_d (u . n)^2 of its area, against u . n, along its normal n.

    u is the velocity relative to the wind. Over a sphere in steady motion, whose front and back both count, this
    adds up to 1/2 density C_d pi R^2 u^2: the integral of |cos|^3 over it is pi R^2. A flat balloon across the wind
    gets twice that for its area, which is about how plates compare with spheres.
    """
    flux = wp.dot(velocity - wind, area_vector)
    return drag_pressure(air_density, coefficient, flux, wp.length_sq(area_vector)) * area_vector


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
