"""The values of a scene that explain what was measured."""

from collections.abc import Callable, Mapping, Sequence
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import BlowUpError, InputError
from balloon_warp.fitting.marquardt import Forward, search
from balloon_warp.fitting.measured import Measured, measured_of
from balloon_warp.fitting.result import Fit, fit_of
from balloon_warp.kernels.laws import Law
from balloon_warp.scene import SceneLike
from balloon_warp.scene.load import scene_of
from balloon_warp.trajectories import Trajectories, simulate

Values = NDArray[np.float64]
ROUNDS = 16
SPREAD = 0.8
"""Fraction of the range between the bounds that starts are spread over"""


def fit(
    scene: SceneLike,
    data: str | Path | Mapping[str, Any],
    *,
    free: Mapping[str, tuple[float, float]],
    starts: int = 8,
    rounds: int = ROUNDS,
    seed: int = 0,
    device: str | None = None,
    schedule: str = "auto",
    laws: Sequence[Law] = (),
    on_stage: Callable[[str], None] = lambda stage: None,
) -> Fit:
    """Find the values of a scene that explain measured data, by least squares from many starts.

    All starts, and all their differences, are worlds of one batch.

    Args:
        scene: Scene that was measured, with all that is known of it.
        data: A .npz file or a mapping: `times` [s], and then `points` with their `particles`, `volumes` or
            `pressures`, of the first balloon; `noise`, `volume_noise` and `pressure_noise` are standard deviations.
            Hidden points are NaN.
        free: Unknown values: dotted paths, and the lowest and highest value. The first is scanned from half-way on.
        starts: Number of starting points.
        rounds: Largest number of steps.
        seed: Seed of the starting points.
        device: A Warp device; if missing, the GPU or else the CPU.
        schedule: As for `simulate`.
        laws: User-defined laws, besides the built-in ones.
        on_stage: Called with a few words at each stage.

    Raises:
        InputError: The data, a path or a bound is wrong, or no start can be simulated.
    """
    scene = scene_of(scene)
    bounds = _bounds(free)
    for name, number in (("starts", starts), ("rounds", rounds)):
        if not isinstance(number, int) or number < 1:
            raise InputError(f"{name}: must be a whole number, at least 1 (got {number})")
    on_stage("reading what was measured")
    once = simulate(scene.model_copy(update={"frames": 1}), device=device, schedule=schedule, laws=laws)
    measured = measured_of(data, once.points[0].shape[1], scene.frames / scene.frames_per_second)
    scene = scene.model_copy(update={"frames": max(1, int(np.ceil(measured.times.max() * scene.frames_per_second)))})

    def run(vary: dict[str, Values], count: int) -> Trajectories:
        return simulate(scene, world_count=count, vary=vary, device=device, schedule=schedule, laws=laws)

    forward = _forward(run, measured, bounds)
    first = 0.5 + SPREAD * (np.random.default_rng(seed).uniform(size=(starts, len(bounds))) - 0.5)

    def on_round(number: int, misfit: float) -> None:
        on_stage(f"round {number}: misfit {misfit:.4g}{' times the noise' if measured.noise_known else ''}")

    on_stage(f"simulating {starts * (len(bounds) + 1)} worlds a round")
    found = search(forward, first, rounds, on_round)
    if not np.isfinite(found.costs).any():
        raise InputError("free: no start can be simulated; expected narrower bounds")
    best = found.best
    slopes = np.array(
        [_slope(low, high, place) for (low, high), place in zip(bounds.values(), found.places[best], strict=True)]
    )
    values = _values(bounds, found.places[best : best + 1])[0]
    misfit = float(np.sqrt(found.costs[best]))
    return fit_of(
        list(bounds), values, found.jacobians[best] / slopes, misfit, measured.noise_known, np.sqrt(found.costs)
    )


def _bounds(free: Mapping[str, tuple[float, float]]) -> dict[str, tuple[float, float]]:
    """Return the free values, checked.

    Raises:
        InputError: nothing is, or a bound is wrong.
    """
    if not free:
        raise InputError("free: expected at least one path, such as balloon.inflation.moles, with its bounds")
    bounds = {}
    for path, pair in free.items():
        try:
            low, high = map(float, pair)
        except (TypeError, ValueError):
            raise InputError(f"free: {path}: expected the lowest and the highest value (got {pair})") from None
        if not (isfinite(low) and isfinite(high) and low < high):
            raise InputError(f"free: {path}: expected a lowest value below the highest (got {low:g} and {high:g})")
        bounds[path] = (low, high)
    return bounds


def _forward(run: Callable[[dict[str, Values], int], Trajectories], measured: Measured, bounds: dict) -> Forward:
    """Return the function from places between the bounds to the residuals of worlds."""

    def forward(places: Values) -> Values:
        values = _values(bounds, places)
        try:
            return _off(run(dict(zip(bounds, values.T, strict=True)), len(values)), len(values), measured)
        except BlowUpError:  # one world takes all with it: each by itself
            pass
        rows: list[Values | None] = []
        for row in values:
            try:
                rows.append(_off(run(dict(zip(bounds, row[:, None], strict=True)), 1), 1, measured)[0])
            except BlowUpError:
                rows.append(None)
        width = next((len(row) for row in rows if row is not None), 1)
        return np.array([np.full(width, np.nan) if row is None else row for row in rows])

    return forward


def _off(moved: Trajectories, count: int, measured: Measured) -> Values:
    """Return the residuals of simulated worlds, shape (count, ...)."""
    alone = moved.pressures.ndim == 2
    tracks: dict[str, Values] = {}
    for name in measured.tracks:
        if name == "points":
            points = moved.points[measured.balloon]
            tracks[name] = (points[None] if alone else points)[:, :, measured.particles].astype(np.float64)
        else:
            track = np.asarray(getattr(moved, name), dtype=np.float64)
            tracks[name] = (track[None] if alone else track)[..., measured.balloon]
    return measured.residuals(tracks, moved.times)


def _values(bounds: dict[str, tuple[float, float]], places: Values) -> Values:
    """Return the values at places between the bounds, shape (n, p), logarithmic where these are above 0."""
    columns = []
    for (low, high), place in zip(bounds.values(), places.T, strict=True):
        columns.append(low * (high / low) ** place if low > 0.0 else low + (high - low) * place)
    return np.stack(columns, axis=1)


def _slope(low: float, high: float, place: float) -> float:
    """Return the derivative of a value by its place."""
    return float(np.log(high / low) * low * (high / low) ** place) if low > 0.0 else high - low
