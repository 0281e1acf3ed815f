"""Runs the cases."""

from collections.abc import Iterator
from dataclasses import asdict, dataclass

import warp as wp

from balloon_warp.benchmarks.cases import CPU_CASES, GPU_CASES, Case
from balloon_warp.benchmarks.measure import bound, seconds_a_frame
from balloon_warp.benchmarks.newton_peer import NewtonPeer
from balloon_warp.errors import MissingExtraError
from balloon_warp.model import build_model, initial_state
from balloon_warp.schedules import make_schedule


@dataclass(frozen=True)
class Result:
    """A case's figures."""

    case: str
    device: str
    schedule: str
    worlds: int
    particles: int
    """in one world"""
    rate: float
    """particle-substeps a second"""
    peer: str | None
    peer_rate: float | None
    ratio: float | None
    """rate over the peer's"""
    bound_fraction: float | None

    def as_json(self) -> dict:
        return asdict(self)


def run_cases(device: wp.Device, quick: bool = False) -> Iterator[Result]:
    """Each case's result, as soon as it is measured."""
    for case in GPU_CASES if device.is_cuda else CPU_CASES:
        if case.quick or not quick:
            yield run_case(case, device)


def run_case(case: Case, device: wp.Device) -> Result:
    """Measure a case, and its peer in the same run."""
    model = build_model(case.scene(), device, case.worlds)
    work = model.world_count * model.particle_count * model.substeps
    schedule = make_schedule(model, case.schedule)
    rate = work / seconds_a_frame(schedule, model, initial_state(model))
    peer_rate = None
    if case.peer:
        try:
            peer_rate = work / seconds_a_frame(NewtonPeer(model), model, initial_state(model))
        except MissingExtraError:
            peer_rate = None
    limit = bound(model, case.schedule)
    return Result(
        case=case.name,
        device=str(device),
        schedule=case.schedule,
        worlds=case.worlds,
        particles=model.particle_count,
        rate=rate,
        peer=NewtonPeer.name if peer_rate else None,
        peer_rate=peer_rate,
        ratio=rate / peer_rate if peer_rate else None,
        bound_fraction=rate / limit if limit else None,
    )
