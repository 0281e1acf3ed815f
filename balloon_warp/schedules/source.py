"""The source of the kernels that a scene gets."""

from balloon_warp.kernels.schedules.launched import source_of
from balloon_warp.model import build_model
from balloon_warp.scene import Scene
from balloon_warp.schedules.block import BlockSchedule
from balloon_warp.schedules.choose import schedule_named
from balloon_warp.schedules.features import model_features
from balloon_warp.schedules.lanes import LanesSchedule
from balloon_warp.schedules.launched import LaunchedSchedule
from balloon_warp.schedules.octet_pull import PullingOctets


def kernel_source(scene: Scene, schedule: str = "gather") -> str:
    """Write the kernels of a scene's substep as text, in the order of their launches.

    Args:
        schedule: any; a block's are for the CPU, whose blocks have one thread.

    Raises:
        InputError: there is no such schedule, or it cannot simulate the scene.
    """
    model = build_model(scene, "cpu")
    named = schedule_named(schedule, model)
    if issubclass(named, (LanesSchedule, BlockSchedule, PullingOctets)):
        return named.source_of(model)
    assert issubclass(named, LaunchedSchedule)
    return source_of(named.step_of(model, model_features(model)))
