"""Gusts: turbulence as a sum of waves (kinematic simulation: Kraichnan 1970, Fung et al. 1992).

Each wave is u = a s(k . x + phase), with a across k, so that the sum has no divergence at all, whatever the periodic
function s is. The lengths of the k are spaced evenly in their logarithm, in shells of three: three directions at right
angles, turned at random, and the a along one another's k, so that no direction is preferred in any shell. The energy of
a shell is that of von Karman's spectrum,

    E(k) ~ (k l)^4 / (1 + (k l)^2)^(17/6),  l = 1.339 L,

L the length over which gusts belong together, the integral scale; beyond it is Kolmogorov's k^(-5/3). The seed
draws the phases. They are carried along by the mean wind and do not change on the way (Taylor's hypothesis).
"""

import math
import random

import warp as wp

from balloon_warp.kernels.written import function_from

SHELLS = 12
OCTAVES = 8.4
"""of wavelengths, from 20 times the length of gusts to its sixteenth"""
LONGEST = 0.3
"""k l of the first shell"""
OVER_LENGTH = 1.339
"""l over L, of von Karman's spectrum"""
SQUARED_WAVE = 0.50033
"""mean of the square of `wave`"""


@wp.func
def wave(turns: float):
    """About sin(2 pi turns), to 0.001, without a sine: with few operations, alike on every device."""
    part = turns - wp.floor(turns) - 0.5
    arch = part * (16.0 * wp.abs(part) - 8.0)
    return arch * (0.775 + 0.225 * wp.abs(arch))


@wp.func
def phase(seed: wp.int32, number: wp.int32):
    """Of a wave, from 0 to 1."""
    state = wp.rand_init(seed, number)
    return wp.randf(state)


def _turned(draw: random.Random) -> list[tuple[float, float, float]]:
    """Three unit vectors at right angles, turned at random: the columns of a unit quaternion's matrix."""
    parts = [draw.gauss(0.0, 1.0) for _ in range(4)]
    w, x, y, z = (part / math.hypot(*parts) for part in parts)
    return [
        (1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)),
        (2 * (x * y - z * w), 1 - 2 * (x * x + z * z), 2 * (y * z + x * w)),
        (2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y)),
    ]


def _waves() -> list[tuple[list[float], list[float]]]:
    """k in turns for each L, and a: each component of their sum has a mean square of 1."""
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


def _written() -> str:
    lines = ["def gusts(place: wp.vec3, seed: wp.int32):", "    sum_of_waves = wp.vec3()"]
    for number, (k, a) in enumerate(_waves()):
        turns = " + ".join(f"({part!r}) * place[{axis}]" for axis, part in enumerate(k))
        along = ", ".join(f"{part!r}" for part in a)
        lines.append(f"    sum_of_waves += wave({turns} + phase(seed, {number})) * wp.vec3({along})")
    return "\n".join([*lines, "    return sum_of_waves\n"])


gusts = function_from("gusts", _written(), {"wave": wave, "phase": phase})
"""(place over L, seed): velocity over the root mean square of each of its components"""
