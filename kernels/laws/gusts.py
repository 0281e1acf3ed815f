"""Gusts: turbulence as a sum of waves (kinematic simulation: Kraichnan 1970, Fung et al. 1992).

Each wave is u = a s(k . x + phase), with a across k, so that the sum has no divergence at all, whatever the periodic
function s is. The lengths of the k are spaced evenly in their logarithm, in shells of three: three directions at right
angles, turned at random, and the a along one another's k, so that no direction is preferred in any shell. The energy of
a shell is that of von Karman's spectrum,

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

import warp as wp

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
