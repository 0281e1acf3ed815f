"""Real-time factor of balloons that touch, beside a peer's in the same run."""

from contextlib import suppress
from typing import Any

import numpy as np
import warp as wp

from balloon_warp.benchmarks.blender_peer import BlenderPeer
from balloon_warp.benchmarks.crowd import CrowdCase
from balloon_warp.benchmarks.measure import seconds_a_frame
from balloon_warp.benchmarks.newton_crowd import NewtonCrowd
from balloon_warp.benchmarks.overlap import deepest_overlap
from balloon_warp.benchmarks.result import Result, beside
from balloon_warp.errors import MissingExtraError
from balloon_warp.model import Model, build_model, initial_state
from balloon_warp.schedules import make_schedule

BLENDER_PRESSURE = 130.0
"""its `uniform_pressure_force` at which its balloons get as wide as ours, a seventh wider as they press each other"""


def measure_crowd(case: CrowdCase, device: wp.Device) -> Result:
    """Measure simulated seconds a second, in turns with an installed peer's, and how deep particles are in balloons."""
    model = build_model(case.scene(), device)
    schedule, peers = make_schedule(model), peers_of(case, model)
    states = [initial_state(model) for _ in (schedule, *peers)]
    times = seconds_a_frame([schedule, *peers], case.frames, states)
    rates = [model.frame_seconds / seconds for seconds in times]
    ended = [states[0].points.numpy()[0], *(peer.points for peer in peers)]
    overlap, *peer_overlaps = [_overlap(points, model) / case.radius for points in ended]
    return Result(
        case=case.name,
        device=str(device),
        schedule=schedule.name,
        worlds=1,
        particles=model.particle_count,
        overlap=overlap,
        peer_overlap=peer_overlaps[0] if peers else None,
        **beside(case.peer, rates),
    )


def peers_of(case: CrowdCase, model: Model) -> list[Any]:
    """Return the case's peer, or none."""
    with suppress(MissingExtraError):
        return [NewtonCrowd(model) if case.peer == "newton" else BlenderPeer(model, BLENDER_PRESSURE)]
    return []


def _overlap(points: np.ndarray, model: Model) -> float:
    """Return the depth of the deepest particle [m]."""
    parts = np.split(points.astype(np.float64), model.particle_offsets[1:-1])
    return deepest_overlap(parts, [shape.mesh for shape in model.shapes])
