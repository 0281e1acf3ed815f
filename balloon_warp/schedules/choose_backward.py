"""Choice of how frames run backwards: in blocks, or as launches."""

from collections.abc import Sequence

from balloon_warp.errors import InputError
from balloon_warp.model import Model
from balloon_warp.model.memory import Counting
from balloon_warp.schedules.backward_block import BlockBackward, fits_in_block_backwards
from balloon_warp.schedules.backward_lanes import LanesBackward, fits_in_lanes_backwards
from balloon_warp.schedules.backward_launched import LaunchedBackward
from balloon_warp.schedules.block_layout import fits_in_block
from balloon_warp.schedules.choose import AS_OCTETS

Backward = type[LaunchedBackward] | type[BlockBackward] | type[LanesBackward]
"""Schedules that run frames backwards"""

BACKWARDS: dict[str, Backward] = {"launched": LaunchedBackward, "block": BlockBackward, "lanes": LanesBackward}


def backwards_of(model: Model, name: str = "auto") -> Backward:
    """Return the backward schedule of a model, whatever the number of its worlds: of that name, or the fastest.

    Raises:
        InputError: there is none of that name, or it cannot run this model backwards.
    """
    fits = fits_in_block_backwards(model)
    if name == "auto":
        name = "lanes" if fits_in_lanes_backwards(model) else "block" if fits else "launched"
    if name not in BACKWARDS:
        raise InputError(f"schedule: expected auto, launched, block or lanes, which run backwards (got {name!r})")
    if name == "lanes" and not fits_in_lanes_backwards(model):
        raise InputError(
            "schedule: lanes runs one balloon of springs or rubber backwards on a CPU, in the air or on the ground, "
            "with a constant amount of gas, and rubber that is not viscous; expected block or launched"
        )
    if name == "block" and not fits:
        raise InputError(
            "schedule: block runs one balloon backwards that fits in a block, out of water, without spheres or "
            "normal forces, with as much gas all the time, and that does not touch itself; expected launched"
        )
    return BACKWARDS[name]


def forward_of(model: Model, backward: Backward) -> str:
    """Return the schedule of the frames forward: one whose results are the same for any number of worlds."""
    if backward is LaunchedBackward:
        return "gather"
    if model.device.is_cpu:
        return AS_OCTETS if backward is LanesBackward and model.world_count > 1 else "octets"
    return "block" if fits_in_block(model) else "gather"


def bytes_backwards(model: Model, columns: Sequence[int], frames: int, name: str = "auto") -> int:
    """Return the device memory that gradients take of each world: a frame's substeps, and a little of each frame."""
    room = Counting()
    backwards_of(model, name).room_of_frame(model, room)
    bars = 4 * model.world_count * model.particle_count * (len(columns) + 24 + 8 * model.sphere_count)
    of_frame = 40 * model.balloon_count + 48 * model.sphere_count
    if model.scene.touches:
        bars += model.world_count * model.particle_count * (85 + 24 * model.balloon_count)
        of_frame += 17 * model.particle_count
    return (room.bytes + bars) // model.world_count + frames * of_frame
