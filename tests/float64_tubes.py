"""Motion of balloons between which gas flows through tubes, in NumPy and double precision."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from float64_run import Motion, started

from balloon_warp.scene import Scene

Array = np.ndarray


def motion_by_tubes(scene: Scene, values: Mapping[str, float]) -> list[Array]:
    """Return places of all balloons in all frames: gas of gamma 1 flows in tubes between them, and leaks."""
    return courses_by_tubes(scene, values)[0]


def courses_by_tubes(
    scene: Scene, values: Mapping[str, float], shifts: tuple[Any, Any] = (0.0, 0.0)
) -> tuple[list[Array], list[Array]]:
    """Return places and velocities of all balloons in all frames.

    Args: shifts: offsets of places and velocities of all particles at the start."""
    runs = [started(scene, values, number) for number in range(len(scene.balloon))]
    for run in runs:
        run.leaks_alone = False
    ends = np.cumsum([len(run.share) for run in runs])[:-1]
    parts = [np.split(np.broadcast_to(each, (sum(len(run.share) for run in runs), 3)), ends) for each in shifts]
    courses = [run.course(*own) for run, *own in zip(runs, *parts, strict=True)]
    found: list[tuple[Array, Array]] = []
    while not found:
        for course in courses:
            try:
                next(course)
            except StopIteration as end:
                found.append(end.value[:2])
        if not found:
            let_flow(runs, [tube.balloons for tube in scene.tube], runs[0].p["tube_conductance"][0])
    points, velocities = zip(*found, strict=True)
    return list(points), list(velocities)


def let_flow(runs: Sequence[Motion], tubes: Sequence[tuple[int, int]], conductances: Array) -> None:
    """Let gas flow between balloons, by the pressures at the substep's end, and several times if flows interact."""
    flows, h, leaks = np.zeros(len(tubes)), runs[0].h, np.zeros(len(runs))
    mole = runs[0].free_volume / runs[0].moles
    open_ones = [number for number, run in enumerate(runs) if run.of("leak") > 0.0]
    for _ in range(8 if len(tubes) > 1 or open_ones else 1):
        for number, (conductance, ends) in enumerate(zip(conductances, tubes, strict=True)):
            one, other = (runs[end] for end in ends)
            driven = conductance * (one.pressure - other.pressure) - flows[number]
            more = driven / (1.0 + conductance * h * mole * (one.slope + other.slope))
            flows[number] += more
            one.pressure -= one.slope * h * more * mole
            other.pressure += other.slope * h * more * mole
        for number in open_ones:
            leaks[number] = runs[number].leak(leaks[number])
    for number in open_ones:
        runs[number].moles -= h * leaks[number]
    for flow, ends in zip(flows, tubes, strict=True):
        runs[ends[0]].moles -= h * flow
        runs[ends[1]].moles += h * flow
