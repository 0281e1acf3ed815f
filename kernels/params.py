"""Parameters and indices of a particle, read once, and the times of a substep."""

from functools import cache
from typing import Any

import warp as wp

from balloon_warp.kernels.compose import function_from
from balloon_warp.kernels.laws.columns import Columns
from balloon_warp.kernels.memory import float_at, int_at, two_in
from balloon_warp.kernels.tables import Tables, WorldState, row_of_world


@wp.struct
class Clock:
    """Clock of launches: a substep's time in the frame, however often its recording is replayed."""

    done: wp.array[wp.int32]
    """Number of substeps by which the frame is further on than the number that a launch is given says; one entry"""
    left: wp.array[wp.int32]
    """Turns that rounds have yet to make, see `frames.rounds`; two entries, the second of rounds within rounds"""
    substep_seconds: wp.float64


@wp.func
def time_in_frame_of(clock: Clock, substep: wp.int32):
    """Return the time at which a substep begins [s]."""
    return float(wp.float64(clock.done[0] + substep) * clock.substep_seconds)


@wp.func
def time_of(t: Tables, frame: wp.array[wp.int32], time_in_frame: float):
    """Return the time since the simulation began [s]."""
    return float(frame[0]) * t.frame_seconds + time_in_frame


@wp.func
def ramp_at(state: WorldState, world: wp.int32, balloon: wp.int32, time_in_frame: float):
    """Return a keyframed value, such as k_normal, at a time in the frame."""
    ramp = two_in(state.inflation_ramp, world, balloon)
    return ramp[0] + ramp[1] * time_in_frame


@cache
def numbers_type(width: int) -> Any:
    """Return the type of a row of parameters in registers."""
    return wp.types.vector(length=width, dtype=wp.float32)


@cache
def numbers_reader(columns: Columns) -> Any:
    """Return the function that reads a balloon's parameters.

    The compiler leaves out numbers that no law names.
    """
    split = columns.balloon_width
    lines = [f"    n[{column}] = float_at(of_balloon, {column})" for column in range(split)]
    lines += [f"    n[{split + column}] = float_at(of_world, {column})" for column in range(columns.world_width)]
    source = "\n".join(
        [
            "def read_numbers(t: Tables, world: wp.int32, balloon: wp.int32):",
            "    of_balloon = t.balloon_numbers[row_of_world(world, t.balloon_numbers.shape[0]), balloon]",
            "    of_world = t.world_numbers[row_of_world(world, t.world_numbers.shape[0])]",
            "    n = Numbers()",
            *lines,
            "    return n\n",
        ]
    )
    names = {"Tables": Tables, "row_of_world": row_of_world, "float_at": float_at}
    return function_from("read_numbers", source, names | {"Numbers": numbers_type(columns.width)})


@cache
def params_functions(columns: Columns, balloons: int = 0) -> tuple[Any, Any]:
    """Return the type of a particle's parameters and indices, and the function that reads them.

    Args:
        balloons: of a world, where that is known: of a single one less has to be read.
    """
    Numbers = numbers_type(columns.width)  # noqa: N806 - a type
    read_numbers = numbers_reader(columns)
    mass_column = columns.places["mass"]

    @wp.struct
    class Params:
        """Parameters and indices of a particle."""

        world: wp.int32
        number: wp.int32
        balloon: wp.int32
        kind: wp.int32  # of its balloon's inflation
        share: float  # of its balloon's mass, 0 if it is fixed
        mass: float  # without gas [kg]
        n: Numbers  # its balloon's and its world's parameters

    @wp.func
    def read_params(t: Tables, world: wp.int32, particle: wp.int32):
        """Read all parameters and indices of a particle."""
        params = Params()
        params.world = world
        params.number = particle
        if wp.static(balloons != 1):
            params.balloon = int_at(t.particles.balloon, particle)
        params.kind = int_at(t.inflation_kind, params.balloon)
        params.share = float_at(t.particles.mass_share, particle)
        params.n = read_numbers(t, world, params.balloon)
        params.mass = params.share * params.n[mass_column]
        return params

    return Params, read_params


@cache
def params_beside_function(columns: Columns, balloons: int = 0) -> Any:
    """Return the function that reads a particle's own data, where its balloon's and world's are already read."""
    Params, _ = params_functions(columns, balloons)  # noqa: N806 - a type
    mass_column = columns.places["mass"]

    @wp.func
    def read_params_beside(t: Tables, beside: Params, particle: wp.int32):
        """Read a particle's parameters and indices, with those of its balloon and world already read."""
        params = Params()
        params.world = beside.world
        params.number = particle
        params.balloon = beside.balloon
        params.kind = beside.kind
        params.n = beside.n
        params.share = float_at(t.particles.mass_share, particle)
        params.mass = params.share * params.n[mass_column]
        return params

    return read_params_beside
