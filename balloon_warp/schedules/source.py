"""The source of the kernels that a scene gets."""

from balloon_warp.errors import InputError
from balloon_warp.kernels.schedules.launched.source import source_of
from balloon_warp.model import build_model
from balloon_warp.scene import Scene
from balloon_warp.schedules.choose import schedule_named
from balloon_warp.schedules.lanes import LanesSchedule
from balloon_warp.schedules.launched import LaunchedSchedule
from balloon_warp.schedules.traits import model_traits


def kernel_source(scene: Scene, schedule: str = "gather") -> str:
    """Write the kernels of a scene's substep as text, in the order of their launches.

    Args:
        schedule: "gather", "scatter", "lanes" or "octets", whose kernels are written from the list of phases.

    Raises:
        InputError: the schedule's kernels are not written from the list, or there is no such schedule.
    """
    model = build_model(scene, "cpu")
    named = schedule_named(schedule, model)
    if issubclass(named, LanesSchedule):
        return named.source_of(model)
    if not issubclass(named, LaunchedSchedule):
        raise InputError(
            f"--schedule {schedule}: the kernels of {named.name} are not written from the list of phases; expected "
            "gather, scatter, lanes or octets"
        )
    return source_of(named.step_of(model, model_traits(model)))
