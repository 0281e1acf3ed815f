"""Outer forces: gravity, helium, damping and inflation, liquids, and air that moves past faces.

Gravity, helium and damping are those of the paper ("Particle Simulation"), lift and drag of faces those of Wejchert and
Haumann (*Animation Aerodynamics*, 1991). Inflation is a force on each particle along its *aim*, or along its area
vector.

- Normal forces, the paper's: F = 100 k_normal (A_p / A_total) n (paper, "Particle Simulation"). A_p is the area of the
  incident face whose center is nearest to the particle, n the particle's Gouraud normal: the mean of the unit normals
  of its incident faces, normalized. The aim is (A_p / A_total) n, which the paper caches over a frame.
- A pressure, given or of a gas: F = p dV/dx, p times the particle's area vector.

A liquid under a level surface presses on the wetted part of each face, cut exactly at the surface. A face is the fan of
triangles about its center. Depth is linear over a triangle, and a corner takes the pressure and the wetted area
weighted by its barycentric coordinate, the center's part being shared out evenly to the face's corners: so force and
torque are those of the hydrostatic pressure on the fan (Kim et al. 2006).
"""

from typing import Any

import warp as wp

from balloon_warp.kernels.laws.air import AIR, WIND, drag_bound
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


@wp.func
def corner_shares(depths: wp.vec3):
    """Return the shares of the corners in the piece that the surface cuts off a triangle at its first corner.

    That corner alone is wet, or alone is dry. They are the integrals of depth times each barycentric coordinate [m],
    and of each coordinate, over the triangle's area.
    """
    along = depths[0] / (depths[0] - depths[1])
    across = depths[0] / (depths[0] - depths[2])
    piece = along * across
    moments = (piece * depths[0] / 12.0) * wp.vec3(4.0 - along - across, along, across)
    areas = (piece / 3.0) * wp.vec3(3.0 - along - across, along, across)
    return moments, areas


@wp.func
def lone_corner(depths: wp.vec3, wet: bool):
    """Return the corner that alone is wet, or alone is dry."""
    if (depths[0] > 0.0) == wet:
        return 0
    if (depths[1] > 0.0) == wet:
        return 1
    return 2


@wp.func
def from_corner(numbers: wp.vec3, corner: wp.int32):
    """Return the numbers of the corners, from one of them on.

    An index that is not known would put them out of registers.
    """
    if corner == 1:
        return wp.vec3(numbers[1], numbers[2], numbers[0])
    if corner == 2:
        return wp.vec3(numbers[2], numbers[0], numbers[1])
    return numbers


@wp.func
def wet_shares(depths: wp.vec3):
    """Return the shares of the corners in the wetted part of a triangle with these depths at its corners [m].

    They are the integrals of depth times each barycentric coordinate [m], and of each coordinate, over the triangle's
    area.
    """
    wet = wp.where(depths[0] > 0.0, 1, 0) + wp.where(depths[1] > 0.0, 1, 0) + wp.where(depths[2] > 0.0, 1, 0)
    moments = wp.vec3()
    areas = wp.vec3()
    if wet > 1:
        moments = (wp.vec3(depths[0] + depths[1] + depths[2]) + depths) / 12.0
        areas = wp.vec3(1.0 / 3.0)
    if wet == 1 or wet == 2:
        lone = lone_corner(depths, wet == 1)
        corner_moments, corner_areas = corner_shares(from_corner(depths, lone))
        sign = wp.where(wet == 1, 1.0, -1.0)
        moments += sign * from_corner(corner_moments, (3 - lone) % 3)
        areas += sign * from_corner(corner_areas, (3 - lone) % 3)
    return moments, areas


@wp.struct
class TriangleLoad:
    """Loads of a triangle's wetted part on its corners."""

    area_vector: wp.vec3
    """Area vector of the whole triangle [m^2]"""
    moments: wp.vec3
    """Integral of depth by corner; times the area vector [m]"""
    areas: wp.vec3
    """Wetted area by corner [m^2]"""


@wp.func
def triangle_load(a: wp.vec3, b: wp.vec3, c: wp.vec3, level: float, up: wp.vec3):
    """Load that water up to a level puts on a triangle."""
    load = TriangleLoad()
    moments, shares = wet_shares(wp.vec3(level - wp.dot(a, up), level - wp.dot(b, up), level - wp.dot(c, up)))
    load.area_vector = 0.5 * wp.cross(a - c, b - c)
    load.moments = moments
    load.areas = wp.length(load.area_vector) * shares
    return load


@wp.func
def corner_load(load: TriangleLoad, moment: float, area: float):
    """Return depth times area vector of a corner, and its wetted area, as one vector."""
    return wp.vec4(moment * load.area_vector[0], moment * load.area_vector[1], moment * load.area_vector[2], area)


@wp.func
def resistance_of_water(water_load: wp.vec4, water_density: float, water_drag: float):
    """Return k of the drag -k |v| v on a particle's wetted area, 1/2 density drag A [kg/m]."""
    return 0.5 * water_density * water_drag * water_load[3]


@wp.func
def water(velocity: wp.vec3, water_load: wp.vec4, gravity: float, water_density: float, water_drag: float):
    """Return the hydrostatic pressure and drag on a particle [N], from its load."""
    pressure = (-water_density * gravity) * wp.vec3(water_load[0], water_load[1], water_load[2])
    resistance = resistance_of_water(water_load, water_density, water_drag) * wp.length(velocity)
    return pressure - resistance * velocity


FROM_THE_SKIN = -1.0
"""Marker: part that follows from the pressure that the skin bears"""
EVENED = Parameter(
    "water_evened",
    "1",
    FROM_THE_SKIN,
    least=0.0,
    most=1.0,
    path="inflation.water_evened",
    meaning='Part of a liquid\'s pressure that lifts a balloon of kind "gas" as a whole, and does not press on its '
    "skin from place to place; what the skin does not bear when missing",
)
TAUT = wp.constant(0.97)
"""Volume of gas at a depth over that at the level, below which a soft skin begins to hang slack"""
SLACK = wp.constant(0.92)
"""Volume of gas over that at the level, below which a soft skin bears nothing"""
WET = wp.constant(0.2)
"""Part of a balloon's volume under water from which on the pressure is evened in full"""


@wp.func
def evened_part(
    least: float, depth: float, lift: float, volume: float, water_density: float, gravity: float, air_pressure: float
):
    """Return the part of a liquid's pressure that acts evenly, deeper and deeper down.

    Where the liquid has taken much of the volume, the skin bears nothing. What hardly dips in is pressed where it is,
    and so floats upright.

    Args:
        least: see `EVENED`.
        depth: of the center of mass [m].
        lift: volume of the displaced liquid [m^3].
        volume: of the balloon [m^3].
    """
    left = air_pressure / wp.max(air_pressure + water_density * gravity * depth, 1.0e-20)
    part = wp.max(least, wp.clamp((TAUT - left) / (TAUT - SLACK), 0.0, 1.0))
    return part * wp.clamp(lift / (WET * wp.max(volume, 1.0e-30)), 0.0, 1.0)


@wp.func
def evened(
    water_load: wp.vec4, area_vector: wp.vec3, share: float, lift: float, height: float, volume: float, up: wp.vec3,
    water_evened: float, water_level: float, water_density: float, gravity: float, air_pressure: float,
):  # fmt: skip
    """Return the force that a particle gets as a part of a liquid's pressure on its balloon acts evenly [N].

    For that part it is pressed as at the depth of the center of mass, and lifted by its share: net force and
    compression stay.

    Args:
        share: of the balloon's mass.
        lift: volume of the displaced liquid [m^3].
        height: of the center of mass [m].
        volume: of the balloon [m^3].
    """
    more = wp.vec3()
    if water_evened > 0.0:
        depth = wp.max(water_level - height, 0.0)
        part = evened_part(water_evened, depth, lift, volume, water_density, gravity, air_pressure)
        load = wp.vec3(water_load[0], water_load[1], water_load[2])
        more = (water_density * gravity * part) * (load - depth * area_vector + (share * lift) * up)
    return more


NO_WATER = -1.0e30
"""Marker: level of a scene without liquid [m]"""
WATER_LEVEL = Parameter(
    "water_level", "m", of="world", path="water.level", meaning="Height of the surface", absent=NO_WATER
)
WATER = Law(
    "particle",
    water,
    (
        WATER_LEVEL,
        Parameter("water_density", "kg/m^3", 1000.0, least=TINY, of="world", path="water.density", meaning="Density"),
        Parameter(
            "water_drag",
            "1",
            1.0,
            least=0.0,
            of="world",
            path="water.drag",
            meaning="Drag coefficient c of 1/2 density c A |v| v, where A is the wetted area moving at v",
        ),
        GRAVITY,
    ),
    wants=lambda scene: scene.water is not None,
    stiffness=lambda area, water_density, gravity: water_density * abs(gravity) * area,
    resistance=resistance_of_water,
)


@wp.func
def air_on_face(velocity: wp.vec3, area_vector: wp.vec3, air: wp.vec4, face_drag: float, face_friction: float):
    """Force of the air on a face [N]: -1/2 density A |u| (C_n u_n + C_t u_t).

    u is the velocity relative to the air, u_n its part along the face's normal, u_t that along the face. A plate of one
    sheet at the angle a to the flow so gets 1/2 density A C_n u^2 sin a along its normal: the lift is cos a of that,
    the drag sin a. On a closed body both sides count: a sphere gets C_d = 4/3 C_n + 8/3 C_t, two sheets twice the force
    of one.
    """
    relative = velocity - wp.vec3(air[0], air[1], air[2])
    area = wp.length(area_vector)
    normal = area_vector / wp.max(area, 1.0e-20)
    across = wp.dot(relative, normal) * normal
    push = face_drag * across + face_friction * (relative - across)
    return (-0.5 * air[3] * area * wp.length(relative)) * push


def face_air_bound(
    area: Any,
    velocity: Any,
    air_pressure: Any,
    air_temperature: Any,
    air_density: Any,
    wind: Any,
    wind_shear: Any,
    wind_height: Any,
    wind_roughness: Any,
    gusts: Any,
    face_drag: Any,
    face_friction: Any,
) -> Any:
    """Return density C A u [N s/m], where C is the larger coefficient, or at most their sum."""
    both = face_drag + face_friction
    given = (wind, wind_shear, wind_height, wind_roughness, gusts)
    return drag_bound(area, velocity, air_pressure, air_temperature, air_density, both, *given)


FACE_AIR = Law(
    "face",
    air_on_face,
    (
        *AIR,
        *WIND,
        Parameter(
            "face_drag",
            "1",
            least=0.0,
            path="face_drag",
            meaning="Normal coefficient C_n of each face in the air: 1/2 density C_n A |u| u_n against the part of u "
            "along the face's normal; it gives lift and drag",
        ),
        Parameter(
            "face_friction",
            "1",
            least=0.0,
            path="face_friction",
            meaning="Tangential coefficient C_t of the air's force along each face, with C_t in place of C_n",
        ),
    ),
    neutral={"face_drag": 0.0, "face_friction": 0.0},
    drag=face_air_bound,
)
