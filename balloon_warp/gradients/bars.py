"""Derivatives by a model's parameters, of those by the state at the start and by the numbers of laws."""

from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from balloon_warp.gradients.by_launches import ByLaunches
from balloon_warp.kernels.laws.columns import Columns
from balloon_warp.model import Model, ModelPlan
from balloon_warp.model.friction import FRICTION, OF_BALLOONS
from balloon_warp.schedules.backward import BackwardFrames

Values = NDArray[np.float64]
ON_GROUND = 0
"""Number of the ground among all things"""


def keyframe_weights(times: Values, time: float) -> Values:
    """Return the part of each keyframe in the value at a time, shape (keyframe_count,), as kernels interpolate."""
    weights = np.zeros(len(times))
    weights[0] = 1.0
    for key, (begin, end) in enumerate(pairwise(times)):
        if time > begin and end > begin:
            blend = min((time - begin) / (end - begin), 1.0)
            weights[:] = 0.0
            weights[key], weights[key + 1] = 1.0 - blend, blend
    return weights


def by_keyframes(model: Model, frame: int, keyed: Values) -> Values:
    """Return derivatives by keyframe values of one frame, shape (W, B, keyframe_count).

    Args:
        keyed: sums of the derivatives by the keyed value over substeps, and of those times the time in the frame [s],
            shape (W, B, 2).
    """
    found = []
    for number, times in enumerate(np.asarray(model.keyframe_times.numpy(), dtype=np.float64)):
        begin = frame * model.frame_seconds
        first, last = (keyframe_weights(times, time) for time in (begin, begin + model.frame_seconds))
        late = keyed[:, number, 1] / model.frame_seconds
        found.append(np.outer(keyed[:, number, 0] - late, first) + np.outer(late, last))
    return np.stack(found, axis=1)


def by_numbers(columns: Columns, wanted: tuple[int, ...], totals: Values) -> dict[str, Values]:
    """Return derivatives by the parameters of laws.

    Args:
        wanted: columns that were derived by.
        totals: shape (W, B, count of them).
    """
    bars: dict[str, Values] = {}
    places = {column: number for number, column in enumerate(wanted)}
    for row in columns.rows:
        own = [places.get(columns.places[row.name] + each) for each in range(row.size)]
        numbers = [place for place in own if place is not None]
        if len(numbers) < row.size:
            continue
        array = totals[:, :, numbers] if row.size > 1 else totals[:, :, numbers[0]]
        bars[row.name] = array if row in columns.balloon else array.sum(axis=1)
    return bars


def columns_of_names(columns: Columns, names: Any) -> tuple[int, ...]:
    """Return the columns of those parameters of laws that are named; friction on the ground has that of balloons."""
    asked = {*names, *(OF_BALLOONS for name in names if name == FRICTION)}
    return tuple(
        columns.places[row.name] + each for row in columns.rows if row.name in asked for each in range(row.size)
    )


def by_friction(model: Model, bars: dict[str, Values]) -> dict[str, Values]:
    """Return derivatives by the coefficients of pairs, of which those of balloons and the ground are known."""
    if OF_BALLOONS not in bars:
        return {}
    of_pairs = np.zeros((model.world_count, *model.parameters[FRICTION].shape[1:]))
    of_pairs[:, -model.balloon_count :, ON_GROUND] = bars.pop(OF_BALLOONS)
    return {FRICTION: of_pairs}


def taken_numbers(model: Model, backward: BackwardFrames, beside: ByLaunches) -> dict[str, Values]:
    """Return derivatives by the numbers of laws, spheres and contacts since they were last taken.

    Args:
        beside: derivatives that only launches find.
    """
    totals = np.asarray(backward.bars.number_totals.numpy(), dtype=np.float64).copy()
    backward.bars.number_totals.zero_()
    of_spheres = backward.spheres.taken_numbers() if backward.spheres else {}
    of_tubes = backward.tubes.taken_numbers() if backward.tubes else {}
    numbers = by_numbers(model.columns, backward.columns, totals)
    of_touch = backward.touch.taken_numbers() if backward.touch else {}
    of_pairs, of_more = by_friction(model, numbers), beside.taken_numbers()
    frictions = [bars[FRICTION] for bars in (of_pairs, of_touch, of_spheres, of_more) if FRICTION in bars]
    found = {**numbers, **of_spheres, **of_touch, **of_tubes, **of_more}
    return found | ({FRICTION: sum(frictions[1:], start=frictions[0])} if frictions else {})


def by_start(plan: ModelPlan, model: Model, points: Values, velocities: Values) -> dict[str, Values]:
    """Return derivatives by where balloons start, and how fast, as `place_balloons` places them.

    Args:
        points: derivatives by the particles' places at the start, shape (W, P, 3).
        velocities: by their velocities.
    """
    worlds, count = len(points), len(plan.shapes)
    names = ("shifts", "centers", "velocities", "spins")
    bars: dict[str, Values] = {f"initial_{name}": np.zeros((worlds, count, 3)) for name in names}
    bars["initial_turns"] = np.zeros((worlds, count, 3, 3))
    origins = np.asarray(model.balloon_origins.numpy(), dtype=np.float64)
    for number, shape in enumerate(plan.shapes):
        own = slice(*model.particle_offsets[number : number + 2])
        arms = shape.mesh.points - origins[number]
        free = (shape.mass_share > 0.0)[:, None]

        def value(name: str, of: int = number) -> Values:
            return np.broadcast_to(plan.parameters[name], (worlds, *plan.parameters[name].shape[1:]))[:, of]

        for world in range(worlds):
            turn, shift, center, spin = (
                value(f"initial_{name}")[world] for name in ("turns", "shifts", "centers", "spins")
            )
            by_velocity = velocities[world, own] * free
            levers = shape.mesh.points + arms @ turn.T + shift - center
            by_lever = np.cross(by_velocity, spin)
            by_place = points[world, own] + by_lever
            bars["initial_shifts"][world, number] = by_place.sum(axis=0)
            bars["initial_centers"][world, number] = -by_lever.sum(axis=0)
            bars["initial_turns"][world, number] = by_place.T @ arms
            bars["initial_velocities"][world, number] = by_velocity.sum(axis=0)
            bars["initial_spins"][world, number] = np.cross(levers, by_velocity).sum(axis=0)
    return bars
