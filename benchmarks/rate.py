"""The rate of a schedule, and Newton's in the same run."""

from contextlib import suppress
from typing import Any

import warp as wp

from balloon_warp.benchmarks.bound import bound
from balloon_warp.benchmarks.cases import CPU_BASE, GPU_BASE, Case, ContactCase
from balloon_warp.benchmarks.measure import seconds_a_frame
from balloon_warp.benchmarks.newton_peer import NewtonPeer
from balloon_warp.benchmarks.result import Result, beside
from balloon_warp.benchmarks.rubber import RubberCase
from balloon_warp.errors import MissingExtraError
from balloon_warp.model import Model, State, build_model, initial_state
from balloon_warp.schedules import make_schedule


def measure_rate(case: Case | ContactCase | RubberCase, device: wp.Device) -> Result:
    """Measure a case's rate, in turns with an installed peer's."""
    schedule = _schedule(case, device)
    peer_name, peers = _peers(case, schedule.model)
    contenders = [schedule, *peers]
    before = case.frames_before if isinstance(case, ContactCase) else 0
    seconds = seconds_a_frame(contenders, states=[_state_after(before, contender) for contender in contenders])
    rates = [_work(contender.model) / each for contender, each in zip(contenders, seconds, strict=True)]
    limit = bound(schedule.model, schedule.name)
    return Result(
        case=case.name,
        device=str(device),
        schedule=schedule.name,
        worlds=case.worlds,
        particles=case.particles,
        bound_fraction=rates[0] / limit if limit else None,
        **beside(peer_name, rates),
    )


def _schedule(case: Case | ContactCase | RubberCase, device: wp.Device) -> Any:
    return make_schedule(build_model(case.scene(), device, case.worlds), case.schedule)


def _state_after(frames: int, schedule: Any) -> State:
    """Return the contender's state at the start, so many frames later."""
    state = initial_state(schedule.model)
    for _ in range(frames):
        schedule.advance_frame(state)
    return state


def _work(model: Model) -> int:
    """Particle-substeps in a frame."""
    return model.world_count * model.particle_count * model.substeps


def _peers(case: Case | ContactCase | RubberCase, model: Model) -> tuple[str, list[Any]]:
    """Return the peer that the case is measured in turns with, and its name, or none."""
    if isinstance(case, (ContactCase, RubberCase)):
        plain = build_model(case.without(), model.device, case.worlds)
        name = "nothing to meet" if isinstance(case, ContactCase) else "springs"
        return name, [make_schedule(plain, case.schedule)]
    if case.peer == "base":
        base = GPU_BASE if model.device.is_cuda else CPU_BASE
        return base.name, [_schedule(base, model.device)]
    if case.peer == "newton":
        with suppress(MissingExtraError):
            return NewtonPeer.name, [NewtonPeer(model)]
    return "", []
