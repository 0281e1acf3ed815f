"""The values of a scene that explain measured data, by least squares."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import BlowUpError, InputError
from balloon_warp.fitting.bounds import Bounds, at_bounds, first_places, slope_at, values_at
from balloon_warp.fitting.cloud import Forward
from balloon_warp.fitting.journal import Journal
from balloon_warp.fitting.measured import Measured, measured_of
from balloon_warp.fitting.result import Fit, fit_of
from balloon_warp.fitting.search import Found, search
from balloon_warp.ownership import sole_writer
from balloon_warp.scene import Scene
from balloon_warp.trajectories import Trajectories

Values = NDArray[np.float64]
MISSES = 1.02
"""Misfit over the noise above which the fit may be another minimum"""
Run = Callable[..., Trajectories]
"""Function of a scene, and of `world_count` and `vary`"""


@dataclass(frozen=True)
class Request:
    """Settings of the search."""

    bounds: Bounds
    starts: int
    rounds: int
    seed: int
    progress: Path | None
    """File that keeps how far it is"""
    resume: bool


def least_squares(
    run: Run, scene: Scene, data: str | Path | Mapping[str, Any], request: Request, on_stage: Callable[[str], None]
) -> Fit:
    """Find the values of a scene that explain measured data.

    Raises:
        InputError: the data are wrong, no start can be simulated, or there is nothing to resume.
    """
    on_stage("reading the measured data")
    once = run(scene.model_copy(update={"frames": 1}))
    measured = measured_of(data, once.points[0].shape[1], scene.frames / scene.frames_per_second)
    scene = scene.model_copy(update={"frames": max(1, int(np.ceil(measured.times.max() * scene.frames_per_second)))})
    forward = _forward(partial(run, scene), measured, request.bounds)
    found = _kept(forward, scene, measured, request, on_stage)
    if not np.isfinite(found.best.cost):
        raise InputError("free: none of the starts can be simulated; expected narrower bounds")
    return _fit_of(found, request.bounds, measured.noise_known)


def _kept(
    forward: Forward, scene: Scene, measured: Measured, request: Request, on_stage: Callable[[str], None]
) -> Found:
    """Search, and keep how far it is."""
    if request.progress is None:
        return _found(forward, measured, request, on_stage)
    asked = {
        "bounds": request.bounds,
        "search": [request.starts, request.rounds, request.seed],
        "scene": scene.model_dump(),
        "data": [float(np.nansum(track)) for track in (measured.times, *measured.tracks.values())],
    }
    with sole_writer(request.progress):
        journal = Journal(request.progress, asked, request.resume)
        if request.resume:
            on_stage(f"resuming after round {journal.rounds}")
        done = False
        try:
            found = _found(journal.remembered(forward), measured, request, on_stage)
            done = True
        finally:
            journal.close(done)
    return found


def _found(forward: Forward, measured: Measured, request: Request, on_stage: Callable[[str], None]) -> Found:
    def on_round(number: int, misfit: float) -> None:
        on_stage(f"round {number}: misfit {misfit:.4g}{' times the noise' if measured.noise_known else ''}")

    first = first_places(request.starts, len(request.bounds), request.seed)
    on_stage(f"simulating {len(first) * (len(request.bounds) + 1)} worlds a round")
    return search(forward, first, request.rounds, on_round, request.seed)


def _fit_of(found: Found, bounds: Bounds, noise_known: bool) -> Fit:
    """Return the result of a search, in the unit of each value."""
    best = found.best
    pairs = zip(bounds.values(), best.place.tolist(), strict=True)
    slopes = np.array([slope_at(low, high, place) for (low, high), place in pairs])
    rough, misfit = best.roughness(noise_known) * np.outer(slopes, slopes), float(np.sqrt(best.cost))
    fit = fit_of(
        list(bounds), values_at(bounds, best.place[None])[0], best.jacobian / slopes, misfit,
        noise_known, np.sqrt(found.costs), at_bounds(bounds, best.place), rough,
    )  # fmt: skip
    if not noise_known or misfit <= MISSES:
        return fit
    return replace(fit, remarks=(f"the misfit is {misfit:.3g} times the noise: more starts may find a better minimum",))


def _forward(run: Run, measured: Measured, bounds: Bounds) -> Forward:
    """Return the function from places between the bounds to the residuals of worlds."""

    def forward(places: Values) -> Values:
        values = values_at(bounds, places)
        try:
            return _off(run(vary=dict(zip(bounds, values.T, strict=True)), world_count=len(values)), measured)
        except BlowUpError:  # one world takes all with it: each by itself
            pass
        rows: list[Values | None] = []
        for row in values:
            try:
                rows.append(_off(run(vary=dict(zip(bounds, row[:, None], strict=True)), world_count=1), measured)[0])
            except BlowUpError:
                rows.append(None)
        width = next((len(row) for row in rows if row is not None), 1)
        return np.array([np.full(width, np.nan) if row is None else row for row in rows])

    return forward


def _off(moved: Trajectories, measured: Measured) -> Values:
    """Return the residuals of simulated worlds, shape (worlds, ...)."""
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
