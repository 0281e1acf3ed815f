"""Stable step of each law alone: stable just under the law's bounds, and unstable just over the limit of its real
forces."""

from functools import cache
from typing import Any

import numpy as np
import pytest
import warp as wp
from lone_laws import AT_THE_END, TESTED, model_of_all, particle_masses, shake, stable_step
from numpy.typing import NDArray

from balloon_warp.kernels.laws import Law
from balloon_warp.model import initial_state
from balloon_warp.schedules.gather import GatherSchedule
from balloon_warp.schedules.readout import ForceReader

BOUND = [law for law in TESTED if law.stiffness or law.drag]
"""laws that ask for a step"""
SHARP = ("hooke", "rubber", "string", "magnet")
"""of whose bodies Gershgorin's bound is the limit itself: two equal masses on one spring, a mass on strings along a
line, masses that know nothing of each other"""
ALIKE_EVERYWHERE = ("magnet",)
"""whose slope is the same wherever the body has gone"""


@cache
def slopes(correction: str) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return derivatives of all forces by all places and velocities at the start, of each world, shape (W, 3 P, 3 P),
    and the forces, shape (W, 3 P)."""
    law = next(law for law in TESTED if model_of_all(law, "cpu")[0].scene.correction == correction)
    model, _ = model_of_all(law, "cpu")
    reader, state = ForceReader(model), initial_state(model)

    def forces(array: Any, values: NDArray[np.float32]) -> NDArray[np.float64]:
        wp.copy(array, wp.array(values, dtype=wp.vec3, device="cpu"))
        reader.refresh(state)
        return reader.net_forces(state).numpy().reshape(len(values), -1).astype(np.float64)

    def slope_by(array: Any, step: float = 0.01) -> NDArray[np.float64]:
        start = array.numpy().copy()
        columns = []
        for particle, axis in np.ndindex(start.shape[1:]):
            aside = np.zeros_like(start)
            aside[:, particle, axis] = step
            columns.append((forces(array, start + aside) - forces(array, start - aside)) / (2.0 * step))
        forces(array, start)
        return np.stack(columns, axis=-1)

    return slope_by(state.points), slope_by(state.velocities), forces(state.points, state.points.numpy().copy())


def throws_back(stiffness: NDArray, drag: NDArray, step: float) -> bool:
    """Return whether a step of symplectic Euler amplifies with alternating sign: an eigenvalue beyond -1. Growth of one
    sign is the body's own, however short the step."""
    unit = np.eye(len(drag))
    kicked = unit + step * drag
    advance = np.block([[unit + step * step * stiffness, step * kicked], [step * stiffness, kicked]])
    values = np.linalg.eigvals(advance)
    return bool(((values.real < 0.0) & (np.abs(values) > 1.001)).any())  # float32's forces are off by some 1e-5


def true_limit(law: Law) -> float:
    """Return the longest step [s] without alternating growth, to 1e-4 of it; infinite if there is no limit."""
    model, world = model_of_all(law, "cpu")
    masses = np.repeat(particle_masses(model), 3)[:, None]
    stiffness, drag = (slope[world] / masses for slope in slopes(model.scene.correction)[:2])
    drag = drag * (law.name not in AT_THE_END)
    steps = np.geomspace(1e-3, 1e2, 100)
    beyond = [throws_back(stiffness, drag, step) for step in steps]
    if not any(beyond):
        return np.inf
    first = int(np.argmax(beyond))
    low, high = steps[max(first - 1, 0)], steps[first]
    while high > 1.0001 * low:
        middle = np.sqrt(low * high)
        low, high = (low, middle) if throws_back(stiffness, drag, middle) else (middle, high)
    return high


def fastest(law: Law, step: float, count: int, points: float, velocities: float) -> float:
    """Return the highest speed of the law's body in so many steps [m/s], from small random displacements."""
    substeps = min(count, 20)
    model, world = model_of_all(law, "cpu", step, substeps)
    schedule, state = GatherSchedule(model), initial_state(model)
    shake(state, points, velocities)
    highest = velocities
    for _ in range(count // substeps):
        schedule.advance_frame(state)
        highest = np.maximum(highest, np.abs(state.velocities.numpy()[world]).max())  # NaN, if it is
    return float(highest)


@pytest.mark.full
@pytest.mark.parametrize("law", BOUND, ids=lambda law: law.name)
def test_just_under_the_step_a_law_stays_as_calm_as_with_half_of_it(law: Law):
    """The speed over 2,000 steps at 0.9 of the stable step stays near that at half of it; a swing of symplectic Euler
    near its limit is up to 1 / root(1 - 0.9^2) = 2.3 times as high."""
    step = stable_step(law)
    under, half = (fastest(law, part * step, round(1800 / part), 1e-3, 1e-4) for part in (0.9, 0.45))
    assert under < 4.0 * half


@pytest.mark.full
@pytest.mark.parametrize("law", BOUND, ids=lambda law: law.name)
def test_the_step_is_not_longer_than_what_forces_really_allow(law: Law):
    step, limit = stable_step(law), true_limit(law)
    assert step <= 1.001 * limit  # see `throws_back`
    assert law.name not in SHARP or step == pytest.approx(limit, rel=1e-3)


@pytest.mark.full
@pytest.mark.parametrize("law", BOUND, ids=lambda law: law.name)
def test_just_over_what_forces_allow_a_body_blows_up(law: Law):
    """A body at 1.05 of the limit grows by at least 1.1 a step, and so by 1e8 in 200; in water the drag ends that at 60
    times its calm speed."""
    model, world = model_of_all(law, "cpu")
    forces = slopes(model.scene.correction)[2][world]
    if np.abs(forces).max() > 1e-5 and law.name not in ALIKE_EVERYWHERE:  # above rounding: 1e-7 of some 10 N
        pytest.skip(f"{law.name} carries its body to where the limit is another")
    if (limit := true_limit(law)) == np.inf:
        pytest.skip(f"{law.name} throws nothing back from where the body starts")
    over = 1.05 * limit
    calm, wild = fastest(law, 0.1 * over, 200, 1e-4, 1e-4), fastest(law, over, 200, 1e-4, 1e-4)
    assert not wild < 30.0 * calm


def test_most_bodies_stay_where_they_are():
    """Most bodies are in equilibrium, as the test above requires: for springs, strings, hinges, water and damping."""
    still = slopes("none")[2]
    assert sum(bool(np.abs(still[model_of_all(law, "cpu")[1]]).max() <= 1e-5) for law in BOUND) >= 7


@pytest.mark.parametrize("law", [law for law in TESTED if law not in BOUND], ids=lambda law: law.name)
def test_a_law_without_bounds_limits_no_step(law: Law):
    assert true_limit(law) == np.inf
