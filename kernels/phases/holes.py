"""Bursting balloons: the area of their holes, and the gas that is left in them."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.clock import ramp_at
from balloon_warp.kernels.laws.air import AIR, air_of_height, molar_volume
from balloon_warp.kernels.laws.body import GRAVITY
from balloon_warp.kernels.laws.columns import Columns
from balloon_warp.kernels.laws.gas import free_volume_of
from balloon_warp.kernels.laws.inflation import GAS
from balloon_warp.kernels.laws.law import TINY
from balloon_warp.kernels.laws.tearing import OPEN
from balloon_warp.kernels.loops.areas import volume_origin
from balloon_warp.kernels.phases.tears import (
    SQUARE_MICROMETERS,
    area_vector_of_face,
    center_of_face,
    face_of,
    unpacked,
)
from balloon_warp.kernels.tables import Tables, WorldState, row_of_world

GasColumns = wp.types.vector(length=6, dtype=wp.int32)
"""Columns of the air's pressure, temperature, density and lapse rate and of gravity in the world's numbers; and of the
gas's gamma in the balloon's"""


@wp.func
def enclosed(t: Tables, points: wp.array[wp.vec3], balloon: wp.int32):
    """Return the volume enclosed by a balloon's faces [m^3]."""
    volume = float(0.0)
    first = t.faces.balloon_offsets[balloon]
    origin = center_of_face(t.faces, points, first)
    for face in range(first, t.faces.balloon_offsets[balloon + 1]):
        center = center_of_face(t.faces, points, face)
        volume += wp.dot(center - origin, area_vector_of_face(t.faces, points, face, center)) / 3.0
    return volume


@wp.func
def seal_air_in(
    t: Tables, state: WorldState, world: wp.int32, balloon: wp.int32, columns: GasColumns, volume: float, height: float
):
    """Seal air of a balloon's volume [m^3] into a balloon with a given pressure."""
    of_world = t.world_numbers[row_of_world(world, t.world_numbers.shape[0])]
    gamma = t.balloon_numbers[row_of_world(world, t.balloon_numbers.shape[0]), balloon, columns[5]]
    air = air_of_height(
        height, of_world[columns[0]], of_world[columns[1]], of_world[columns[2]], of_world[columns[3]],
        of_world[columns[4]],
    )  # fmt: skip
    pressure = wp.max(air[0] + state.pressures[world, balloon], 0.0)
    state.gas_amounts[world, balloon] = wp.float64(volume / molar_volume(wp.max(pressure, TINY), air[1]))
    state.free_volumes[world, balloon] = wp.float64(
        free_volume_of(volume, pressure, gamma, air[1] / of_world[columns[1]])
    )


@cache
def opening_function(columns: Columns) -> Any:
    """Make the function by which a balloon bursts, and that finds how large its hole is, through which gas leaves."""
    places, split = columns.places, columns.balloon_width
    told = GasColumns(*(places[row.name] - split for row in (*AIR, GRAVITY)), places["gamma"])

    @wp.func
    def open_balloon(
        t: Tables,
        state: WorldState,
        points: wp.array[wp.vec3],
        world: wp.int32,
        balloon: wp.int32,
        time_in_frame: float,
        time: float,
    ):
        tears = t.membranes.wear.tears
        burst = state.bursts[world, balloon]
        weakest = tears.weakest[world, balloon]
        tears.weakest[world, balloon] = wp.int64(0)
        if burst[0] < 0.0 and weakest > wp.int64(0):
            if t.inflation_kind[balloon] != GAS:
                state.pressures[world, balloon] = ramp_at(state, world, balloon, time_in_frame)
                height = wp.dot(points[volume_origin(t, balloon)], t.up)
                volume = enclosed(t, points, balloon)
                seal_air_in(t, state, world, balloon, told, wp.max(volume, 0.0), height)
            burst = wp.vec4(time, 0.0, float(face_of(weakest)), unpacked(weakest))
        elif burst[0] >= 0.0 and burst[1] >= 0.0:  # from the next substep on, by the load that this one finds
            hole = float(wp.float64(tears.areas[world, balloon, 0]) / SQUARE_MICROMETERS)
            whole = float(wp.float64(tears.areas[world, balloon, 1]) / SQUARE_MICROMETERS)
            burst[1] = hole
            if whole > 0.0 and hole > OPEN * (hole + whole):
                burst[1] = -1.0
                state.gas_amounts[world, balloon] = wp.float64(0.0)
                state.free_volumes[world, balloon] = wp.float64(0.0)
        state.bursts[world, balloon] = burst
        tears.areas[world, balloon, 0] = wp.int64(0)
        tears.areas[world, balloon, 1] = wp.int64(0)

    return open_balloon
