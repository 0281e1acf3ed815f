"""Which schedule simulates a model."""

from typing import Protocol

from balloon_warp.errors import InputError
from balloon_warp.model import Model, State
from balloon_warp.schedules.block import BlockSchedule, fits_in_block, thread_a_particle
from balloon_warp.schedules.gather import GatherSchedule
from balloon_warp.schedules.lanes import LanesSchedule
from balloon_warp.schedules.scatter import ScatterSchedule

SCHEDULES = {schedule.name: schedule for schedule in (ScatterSchedule, GatherSchedule, BlockSchedule, LanesSchedule)}


class Schedule(Protocol):
    """Advances states of a model by whole frames."""

    name: str
    capturable: bool
    """whether a frame is nothing but launches, so that it can be recorded once and replayed"""

    def advance_frame(self, state: State) -> None:
        """Advance every world by one frame, in place."""


def make_schedule(model: Model, name: str = "auto") -> Schedule:
    """The schedule of that name, or the fastest for the model.

    Raises:
        InputError: there is no such schedule, or it cannot simulate this model.
    """
    if name == "auto":
        name = fastest_schedule(model)
    if name not in SCHEDULES:
        raise InputError(f"--schedule {name}: no such schedule; there are auto, {', '.join(SCHEDULES)}")
    return SCHEDULES[name](model)


def fastest_schedule(model: Model, world_count: int | None = None) -> str:
    """By device, size and number of worlds: the model's, or that of a batch of which the model is a part.

    On a GPU, blocks where a world fits in one and either each particle has a thread, or there are enough worlds to give
    each multiprocessor one. On the CPU, eight worlds side by side cost little more than one, but one costs as much.
    """
    worlds = world_count or model.world_count
    if model.device.is_cpu:
        return "lanes" if worlds > 1 else "gather"
    enough = thread_a_particle(model) or worlds >= model.device.sm_count
    return "block" if fits_in_block(model) and enough else "gather"
