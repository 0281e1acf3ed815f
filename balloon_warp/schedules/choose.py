"""Which schedule simulates a model."""

from typing import Protocol

from balloon_warp.errors import InputError
from balloon_warp.model import Model, State
from balloon_warp.schedules.block import BlockSchedule
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


def fastest_schedule(model: Model) -> str:
    """By device and size: eight worlds side by side cost little more than one, but one costs as much as eight."""
    if model.device.is_cpu and model.world_count > 1:
        return "lanes"
    return "gather"
