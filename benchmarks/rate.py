"""The rate of a schedule, and Newton's in the same run."""

import warp as wp

from balloon_warp.benchmarks.bound import bound
from balloon_warp.benchmarks.cases import Case
from balloon_warp.benchmarks.measure import seconds_a_frame
from balloon_warp.benchmarks.newton_peer import NewtonPeer
from balloon_warp.benchmarks.result import Result
from balloon_warp.errors import MissingExtraError
from balloon_warp.model import Model, build_model, initial_state
from balloon_warp.schedules import make_schedule


def measure_rate(case: Case, device: wp.Device) -> Result:
    """A case's rate, in turns with Newton's where that is asked for and installed."""
    model = build_model(case.scene(), device, case.worlds)
    schedule = make_schedule(model, case.schedule)
    peers = _peers(model) if case.peer else []
    contenders = [(contender, initial_state(model)) for contender in [schedule, *peers]]
    work = model.world_count * model.particle_count * model.substeps
    rate, *peer_rates = [work / seconds for seconds in seconds_a_frame(contenders, model)]
    limit = bound(model, schedule.name)
    return Result(
        case=case.name,
        device=str(device),
        schedule=schedule.name,
        worlds=case.worlds,
        particles=model.particle_count,
        rate=rate,
        peer=peers[0].name if peers else None,
        peer_rate=peer_rates[0] if peers else None,
        ratio=rate / peer_rates[0] if peers else None,
        bound_fraction=rate / limit if limit else None,
    )


def _peers(model: Model) -> list[NewtonPeer]:
    try:
        return [NewtonPeer(model)]
    except MissingExtraError:
        return []
