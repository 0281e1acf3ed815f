"""Air around balloons: its pressure, density, wind and gusts.

Gusts: turbulence as a sum of waves (kinematic simulation: Kraichnan 1970, Fung et al. 1992). Each wave is u = a s(k . x
+ phase), with a across k, so that the sum has no divergence at all, whatever the periodic function s is. The lengths of
the k are spaced evenly in their logarithm, in shells of three: three directions at right angles, turned at random, and
the a along one another's k, so that no direction is preferred in any shell. The energy of a shell is that of von
Karman's spectrum,

    E(k) ~ (k l)^4 / (1 + (k l)^2)^(17/6),  l = 1.339 L,

L the length over which gusts belong together, the integral scale; beyond it is Kolmogorov's k^(-5/3). The waves end at
L/300: from L/40 to L/5 the mean squares of differences grow with the distance to the 2/3, within 0.1 of that exponent,
and below L/300 with its square, as in a smooth field. The seed draws the phases. They are carried along by the mean
wind and do not change on the way (Taylor's hypothesis).

The waves stand in a table, which a loop goes through: written out one by one they took a compiler a minute. On a CPU
eight of them share its vector registers.
"""

import math
import random
from typing import Any

import warp as wp

from balloon_warp.kernels.laws.law import TINY, Law, Parameter

SHELLS = 16
OCTAVES = 12.75
"""Octaves of wavelengths, from 28 times the gust length to a 240th of it, and to a 300th within the last shell"""
LONGEST = 0.3
"""Dimensionless wave number k l of the first shell"""
OVER_LENGTH = 1.339
"""Ratio l / L of von Karman's spectrum"""
SQUARED_WAVE = 0.50033
"""Mean square of `wave`"""
AT_ONCE = 8
"""Number of waves that a CPU sums at once"""


def _turned(draw: random.Random) -> list[tuple[float, float, float]]:
    """Return three unit vectors at right angles, turned at random: the columns of a unit quaternion's matrix."""
    parts = [draw.gauss(0.0, 1.0) for _ in range(4)]
    w, x, y, z = (part / math.hypot(*parts) for part in parts)
    return [
        (1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)),
        (2 * (x * y - z * w), 1 - 2 * (x * x + z * z), 2 * (y * z + x * w)),
        (2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y)),
    ]


def waves() -> list[tuple[list[float], list[float]]]:
    """Return wave vectors k L and amplitudes a of all waves, with a mean square of 1 for each component of the sum."""
    draw = random.Random(1)
    step = OCTAVES / (SHELLS - 1)
    lengths = [LONGEST * 2.0 ** (step * shell) for shell in range(SHELLS)]
    energies = [k**5 / (1.0 + k * k) ** (17.0 / 6.0) for k in lengths]  # E(k) k, as shells are even in ln k
    waves = []
    for k, energy in zip(lengths, energies, strict=True):
        axes = _turned(draw)
        amplitude = math.sqrt(energy / sum(energies) / SQUARED_WAVE)
        for number in range(3):  # three lengths within a shell, so that no two waves keep time
            turns = k * 2.0 ** (step * (number - 1) / 3.0) / (OVER_LENGTH * 2.0 * math.pi)
            along = axes[(number + 1) % 3]
            waves.append(([turns * part for part in axes[number]], [amplitude * part for part in along]))
    return waves


def _listed(numbers: list[float]) -> str:
    return ", ".join(f"{number!r}f" for number in numbers)


def _table_by_wave() -> str:
    return _listed([number for k, a in waves() for number in (*k, *a)])


def _fours_by_wave() -> str:
    """Arrange each wave as two fours: its wave vector and the hash of its number, and its amplitude."""
    fours = (
        (*map("{!r}f".format, k), f"{hashed(number)}u", *map("{!r}f".format, a), "0u")
        for number, (k, a) in enumerate(waves())
    )
    return ", ".join(
        f"{{{k0}, {k1}, {k2}, {phase}}}, {{{a0}, {a1}, {a2}, {rest}}}" for k0, k1, k2, phase, a0, a1, a2, rest in fours
    )


def _table_by_number() -> str:
    """Arrange each number of all waves side by side, filled up to whole vectors."""
    rows = [[wave[which][axis] for wave in waves()] for which in range(2) for axis in range(3)]
    return _listed([number for row in rows for number in (*row, *[0.0] * (-len(row) % AT_ONCE))])


def hashed(state: int) -> int:
    """Return the hash of a number, Warp's `rand_pcg`."""
    mixed = (state * 747796405 + 2891336453) % 2**32
    mixed = ((mixed >> ((mixed >> 28) + 4)) ^ mixed) * 277803737 % 2**32
    return (mixed >> 22) ^ mixed


def _written() -> str:
    """Write the sum of the waves in C++.

    A wave is about sin(2 pi turns), to 0.001, without a sine: with few operations, alike on every device. Its phase is
    `randf` of `rand_init(seed, number)`, from 0 to 1. The threads of a warp of one world share out the waves, of which
    each draws some phases for all, less the half turn from which a wave's middle is told; written out, they find all
    else in their instructions.
    """
    count, vectors = 3 * SHELLS, -(-3 * SHELLS // AT_ONCE)
    hashes = ", ".join(f"{hashed(number)}u" for number in range(AT_ONCE * vectors))
    return f"""
#if defined(__CUDA_ARCH__)
    struct alignas(16) Four {{ float x, y, z; wp::uint32 hash; }};
    static constexpr Four waves[{2 * count}] = {{{_fours_by_wave()}}};
    const auto middle_of = [&](int number) {{
        wp::uint32 state = wp::rand_pcg(wp::uint32(seed) + waves[2 * number].hash);
        return wp::randf(state) - 0.5f;
    }};
    wp::vec3 sum;
    const auto add = [&](int number, float middle) {{
        const Four k = waves[2 * number], a = waves[2 * number + 1];
        const float turns = middle + k.x * place[0] + k.y * place[1] + k.z * place[2];
        const float part = turns - rintf(turns);
        const float arch = part * (16.0f * fabsf(part) - 8.0f);
        const float wave = arch * (0.775f + 0.225f * fabsf(arch));
        sum += wp::vec3(wave * a.x, wave * a.y, wave * a.z);
    }};
    const unsigned whole = 0xffffffffu;
    int alike = 0;
    if (__activemask() == whole)
        __match_all_sync(whole, seed, &alike);
    if (alike) {{
        const int lane = threadIdx.x & 31;
        #pragma unroll
        for (int begin = 0; begin < {count}; begin += 32) {{
            const float own = middle_of(min(begin + lane, {count} - 1));
            #pragma unroll
            for (int number = 0; number < min(32, {count} - begin); ++number)
                add(begin + number, __shfl_sync(whole, own, number));
        }}
    }} else {{
        #pragma unroll 1
        for (int number = 0; number < {count}; ++number)
            add(number, middle_of(number));
    }}
    return sum;
#else
    typedef float eight __attribute__((vector_size(32), aligned(4)));
    typedef float four __attribute__((vector_size(16)));
    typedef wp::uint32 bits __attribute__((vector_size(32), aligned(4)));
    static constexpr float waves[{6 * AT_ONCE * vectors}] = {{{_table_by_number()}}};
    static constexpr wp::uint32 hashes[{AT_ONCE * vectors}] = {{{hashes}}};
    const eight* w = reinterpret_cast<const eight*>(waves);
    eight sums[3] = {{}};
    for (int number = 0; number < {vectors}; ++number) {{
        const eight* k = w + number;
        bits state = wp::uint32(seed) + reinterpret_cast<const bits*>(hashes)[number];
        for (int draw = 0; draw < 2; ++draw) {{
            state = state * 747796405u + 2891336453u;
            state = ((state >> ((state >> 28u) + 4u)) ^ state) * 277803737u;
            state = (state >> 22u) ^ state;
        }}
        const eight phase = __builtin_convertvector(state >> 8u, eight) * 0x1p-24f;
        const eight turns = k[0] * place[0] + k[{vectors}] * place[1] + k[{2 * vectors}] * place[2] + phase;
        const eight part = turns - __builtin_elementwise_floor(turns) - 0.5f;
        const eight arch = part * (16.0f * __builtin_elementwise_abs(part) - 8.0f);
        const eight wave = arch * (0.775f + 0.225f * __builtin_elementwise_abs(arch));
        for (int axis = 0; axis < 3; ++axis)
            sums[axis] += wave * k[(3 + axis) * {vectors}];
    }}
    wp::vec3 sum;
    for (int axis = 0; axis < 3; ++axis) {{
        const eight s = sums[axis];
        const four half = __builtin_shufflevector(s, s, 0, 1, 2, 3) + __builtin_shufflevector(s, s, 4, 5, 6, 7);
        sum[axis] = (half[0] + half[2]) + (half[1] + half[3]);
    }}
    return sum;
#endif
"""


def _derived() -> str:
    """Write the derivative of the sum by the place in C++, on every device one wave after the other."""
    count = 3 * SHELLS
    return f"""
    static constexpr float waves[{6 * count}] = {{{_table_by_wave()}}};
    for (int number = 0; number < {count}; ++number) {{
        const float* w = waves + 6 * number;
        wp::uint32 state = wp::rand_init(seed, number);
        const float turns = w[0] * place[0] + w[1] * place[1] + w[2] * place[2] + wp::randf(state);
        const float part = turns - floorf(turns) - 0.5f;
        const float arch = part * (16.0f * fabsf(part) - 8.0f);
        const float rise = (32.0f * fabsf(part) - 8.0f) * (0.775f + 0.45f * fabsf(arch));
        const float along = rise * (w[3] * adj_ret[0] + w[4] * adj_ret[1] + w[5] * adj_ret[2]);
        adj_place += along * wp::vec3(w[0], w[1], w[2]);
    }}
"""


@wp.func_native(_written(), adj_snippet=_derived())
def gusts_at(place: wp.vec3, seed: wp.int32) -> wp.vec3:
    """Return the velocity over the root mean square of each of its components, at a place over L."""
    ...


GAS_CONSTANT = 8.314462618
"""Molar gas constant R [J/(mol K)]"""
DRY_AIR_MOLAR_MASS = 0.0289652
"""Molar mass of dry air [kg/mol]"""
OF_DRY_AIR = -1.0
"""Marker: density of dry air as an ideal gas"""
ALIKE = -1.0
"""Marker: uniform air, without a lapse rate"""
HIGHEST = 0.9
"""Largest fraction of its temperature that the air loses with height"""
MOST_GROWTH = 10.0
"""Largest height for the wind's growth, over `wind_height`"""
SMOOTHEST = 0.99
"""Upper limit of the roughness length, as a fraction of `wind_height`"""


@wp.func
def molar_volume(air_pressure: float, air_temperature: float):
    """Return the molar volume of an ideal gas at the air's temperature and pressure, R T / p [m^3/mol]."""
    return GAS_CONSTANT * air_temperature / air_pressure


@wp.func
def density_of_air(air_pressure: float, air_temperature: float, air_density: float):
    """Return the given density of the air, or that of dry air as an ideal gas where it is negative [kg/m^3]."""
    if air_density < 0.0:
        return DRY_AIR_MOLAR_MASS / molar_volume(air_pressure, air_temperature)
    return air_density


@wp.func
def air_of_height(
    height: float,
    air_pressure: float,
    air_temperature: float,
    air_density: float,
    air_lapse: float,
    gravity: float,
):
    """Return pressure [Pa], temperature [K] and density [kg/m^3] of the air at a height, from those at 0.

    The air is at rest, dp/dz = -density g, and as much colder with height as its lapse L says [K/m]:

        T = T_0 - L z,  p = p_0 (T / T_0)^(density_0 g T_0 / (p_0 L)),  density = density_0 (p / p_0) (T_0 / T),

    and p = p_0 exp(-density_0 g z / p_0) where L = 0 (the barometric formula; U.S. Standard Atmosphere 1976).
    """
    density = density_of_air(air_pressure, air_temperature, air_density)
    air = wp.vec3(air_pressure, air_temperature, density)
    if air_lapse > ALIKE:
        colder = wp.min(air_lapse * height / air_temperature, HIGHEST)
        more = 1.0 + 0.5 * colder  # -ln(1 - x) / x
        if wp.abs(colder) > 1.0e-3:
            more = -wp.log(1.0 - colder) / colder
        ratio = wp.exp(-density * gravity * height * more / air_pressure)
        air = wp.vec3(air_pressure * ratio, air_temperature * (1.0 - colder), density * ratio / (1.0 - colder))
    return air


@wp.func
def density_at(
    place: wp.vec3,
    up: wp.vec3,
    air_pressure: float,
    air_temperature: float,
    air_density: float,
    air_lapse: float,
    gravity: float,
):
    """Return the density of the air at a place [kg/m^3]."""
    return air_of_height(wp.dot(place, up), air_pressure, air_temperature, air_density, air_lapse, gravity)[2]


@wp.func
def wind_alike(wind: wp.vec3):
    """Return the velocity of uniform, steady air [m/s]."""
    return wind


@wp.func
def growth_of_wind(height: float, wind_shear: float, wind_height: float, wind_roughness: float):
    """Wind at a height over that at `wind_height`, up to ten times that height.

    It is (z / wind_height)^wind_shear; or by the roughness length z_0 of the ground ln(z / z_0) / ln(wind_height /
    z_0), nothing up to z_0: the profile of air that is neither warmed nor cooled from below (Wieringa 1992, Updating
    the Davenport roughness classification).
    """
    growth = float(1.0)
    if wind_roughness > 0.0:
        most = MOST_GROWTH * wind_height
        here = wp.clamp(height, wind_roughness, most) / wind_roughness
        growth = wp.log(here) / wp.log(wp.max(wind_height / wind_roughness, wp.static(1.0 / SMOOTHEST)))
    elif wind_shear > 0.0:
        growth = 0.0
        if height > 0.0:  # the power of 0 has no derivative
            growth = wp.pow(wp.min(height / wind_height, MOST_GROWTH), wind_shear)
    return growth


@wp.func
def wind_at(
    place: wp.vec3,
    up: wp.vec3,
    time: float,
    wind: wp.vec3,
    wind_shear: float,
    wind_height: float,
    wind_roughness: float,
    gusts: float,
    gust_length: float,
    gust_seed: float,
):
    """Return the velocity of the air at a place and time, with the wind's profile and gusts [m/s]."""
    velocity = growth_of_wind(wp.dot(place, up), wind_shear, wind_height, wind_roughness) * wind
    if gusts > 0.0:
        carried = (place - time * wind) / gust_length
        velocity += (gusts * wp.length(wind)) * gusts_at(carried, wp.int32(gust_seed))
    return velocity


AIR_ALIKE = (wind_alike, density_of_air)
"""Functions for velocity and density of uniform, steady air"""
AIR_THAT_VARIES = (wind_at, density_at)
"""Functions for velocity and density of air that varies with place and time"""


@wp.func
def air_drag(velocity: wp.vec3, area_vector: wp.vec3, air: wp.vec4, drag_coefficient: float):
    """Force of the air on a particle [N]: 1/2 density C_d (u . n)^2 of its area, against u . n, along its normal n.

    u is the velocity relative to the air. Over a sphere in steady motion, whose front and back both count, this
    adds up to 1/2 density C_d pi R^2 u^2: the integral of |cos|^3 over it is pi R^2. A flat balloon across the wind
    gets twice that for its area, which is about how plates compare with spheres.
    """
    flux = wp.dot(velocity - wp.vec3(air[0], air[1], air[2]), area_vector)
    squared_area = wp.max(wp.length_sq(area_vector), 1.0e-30)
    return (-0.5 * air[3] * drag_coefficient * flux * wp.abs(flux) / squared_area) * area_vector


AIR = (
    Parameter(
        "air_pressure", "Pa", 101325.0, least=TINY, of="world", path="atmosphere.pressure", meaning="Air pressure"
    ),
    Parameter(
        "air_temperature",
        "K",
        293.15,
        least=TINY,
        of="world",
        path="atmosphere.temperature",
        meaning="Temperature of the air, and of gas at its pressure",
    ),
    Parameter(
        "air_density",
        "kg/m^3",
        OF_DRY_AIR,
        least=0.0,
        of="world",
        path="atmosphere.density",
        meaning="Density of the air; when missing, that of dry air as an ideal gas",
    ),
    Parameter(
        "air_lapse",
        "K/m",
        ALIKE,
        least=-0.1,
        most=0.1,
        of="world",
        path="atmosphere.lapse",
        meaning="Lapse rate, the decrease of temperature with height: 0.0065 in the standard atmosphere up to 11 km, 0 "
        "isothermal, below 0 where it is warmer above. Pressure and density, given at height 0, fall with height. "
        "Uniform air when missing",
    ),
)
STATE_OF_AIR = AIR[:3]
"""Parameters for pressure, temperature and density of the air"""
WIND = (
    Parameter("wind", "m/s", of="world", path="atmosphere.wind", size=3, meaning="Wind velocity"),
    Parameter(
        "wind_shear",
        "1",
        least=0.0,
        most=2.0,
        of="world",
        path="atmosphere.shear",
        meaning="Exponent of the wind's power law, from no wind at height 0 up to ten times `wind_height`: 0.14 "
        "over open land, 0.3 in towns, 0 uniform",
    ),
    Parameter(
        "wind_height",
        "m",
        10.0,
        least=TINY,
        of="world",
        path="atmosphere.wind_height",
        meaning="Height at which `wind` is given, where it grows with height",
    ),
    Parameter(
        "wind_roughness",
        "m",
        least=0.0,
        of="world",
        path="atmosphere.roughness",
        meaning="Roughness length of the ground in the wind's logarithmic law, up to ten times `wind_height`: "
        "0.0002 over the open sea, 0.03 over grass, 0.25 over high crops, 1 in suburbs; 0 is none; or else `shear`",
    ),
    Parameter(
        "gusts",
        "1",
        least=0.0,
        most=2.0,
        of="world",
        path="atmosphere.gusts",
        meaning="Turbulence intensity: root mean square of each component of the gusts' velocity over the wind "
        "speed; 0.1 on a calm day, 0.3 in streets",
    ),
    Parameter(
        "gust_length",
        "m",
        10.0,
        least=TINY,
        of="world",
        path="atmosphere.gust_length",
        meaning="Integral length scale of the turbulence",
        domain=(1.0, 1e4),
    ),
    Parameter(
        "gust_seed",
        "1",
        0,
        least=0.0,
        most=1e6,
        of="world",
        path="atmosphere.gust_seed",
        meaning="Seed of the random gusts",
    ),
)
VARYING = {"air_lapse": ALIKE, "wind_shear": 0.0, "wind_roughness": 0.0, "gusts": 0.0}
"""Parameters that make the air vary from place to place, with their neutral values"""
LARGEST_GUST = 4.0
"""Largest gust that the step allows for, over the root mean square of one component"""


def drag_bound(
    area: Any,
    velocity: Any,
    air_pressure: Any,
    air_temperature: Any,
    air_density: Any,
    drag_coefficient: Any,
    wind: Any,
    wind_shear: Any,
    wind_height: Any,
    wind_roughness: Any,
    gusts: Any,
) -> Any:
    """Return density C_d A u [N s/m], the derivative of the drag at the speed u through the air."""
    density = density_of_given_air(air_pressure, air_temperature, air_density)
    share = wind_roughness / wind_height
    share = 0.5 * (share + SMOOTHEST - abs(share - SMOOTHEST))  # the lesser of both, of arrays, too
    logarithm = 64.0 * (1.0 - share ** (1.0 / 64.0))  # no more than -ln of that, nor less by a tenth
    rough = 1.0 * (wind_roughness > 0.0)
    most = rough * (1.0 + math.log(MOST_GROWTH) / logarithm) + (1.0 - rough) * MOST_GROWTH**wind_shear
    more = most - 1.0 + LARGEST_GUST * gusts
    speed = ((velocity - wind) ** 2).sum(axis=-1) ** 0.5 + more * (wind**2).sum(axis=-1) ** 0.5
    return density * drag_coefficient * area * speed


def density_of_given_air(air_pressure: Any, air_temperature: Any, air_density: Any) -> Any:
    """Find the density of `density_of_air` on the host, for many worlds [kg/m^3]."""
    dry = DRY_AIR_MOLAR_MASS / (GAS_CONSTANT * air_temperature / air_pressure)
    return (air_density < 0.0) * dry + (air_density >= 0.0) * air_density


AIR_DRAG = Law(
    "particle",
    air_drag,
    (
        *AIR,
        Parameter(
            "drag_coefficient",
            "1",
            least=0.0,
            path="drag_coefficient",
            meaning="Drag coefficient C_d of 1/2 density C_d A u^2, as for a sphere, at airspeed u",
        ),
        *WIND,
    ),
    neutral={"drag_coefficient": 0.0},
    drag=drag_bound,
)
