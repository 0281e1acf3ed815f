"""Real-time factor of one balloon, beside Blender's cloth in the same run."""

import warp as wp

from balloon_warp.benchmarks.blender_peer import BlenderPeer
from balloon_warp.benchmarks.cases import RealTimeCase
from balloon_warp.benchmarks.measure import seconds_a_frame
from balloon_warp.benchmarks.result import Result, beside
from balloon_warp.errors import MissingExtraError
from balloon_warp.model import Model, build_model
from balloon_warp.schedules import make_schedule


def measure_real_time(case: RealTimeCase, device: wp.Device) -> Result:
    """Measure simulated seconds a second, in turns with an installed Blender's."""
    model = build_model(case.scene(), device)
    schedule = make_schedule(model)
    peers = _peers(model)
    rates = [model.frame_seconds / seconds for seconds in seconds_a_frame([schedule, *peers])]
    return Result(
        case=case.name,
        device=str(device),
        schedule=schedule.name,
        worlds=1,
        particles=model.particle_count,
        **beside(BlenderPeer.name, rates),
    )


def _peers(model: Model) -> list[BlenderPeer]:
    try:
        return [BlenderPeer(model)]
    except MissingExtraError:
        return []
