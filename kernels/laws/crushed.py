"""A given pressure below that outside: the balloon is crushed flat, and stays so.

Water above a balloon, or a pressure below the air's, takes its volume for as long as there is any. Then its walls lie
on each other, and what the one bears the other holds: a skin whose volume is used up bears no further pressure.
"""

import warp as wp

from balloon_warp.kernels.laws.empty import EMPTY
from balloon_warp.kernels.laws.gas import HEIGHT, RATE, RESPONSE, RESPONSE_HEIGHT, VOLUME, Swelling

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
