"""Fits: the values of a scene that explain a measured motion by least squares, or for which a loss is least.

A journal keeps the residuals of simulated worlds in a file, from which `--resume` goes on. A search asks for the same
places each time, as long as it gets the same answers. So it goes through those of the file again, without simulating,
to where it was stopped.
"""

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, overload

import numpy as np
from numpy.typing import NDArray

from balloon_warp.batch.trajectories import Trajectories, simulate
from balloon_warp.errors import BlowUpError, InputError
from balloon_warp.kernels.laws import Law
from balloon_warp.lab.fit.search import (
    Bounds,
    Forward,
    Found,
    at_bounds,
    checked_bounds,
    first_places,
    minima_together,
    search,
    slope_at,
    values_at,
)
from balloon_warp.lab.gradients.derive import DerivativeRequest, Gradient
from balloon_warp.lab.gradients.gradient import derived
from balloon_warp.lab.gradients.losses import Loss
from balloon_warp.model import Vary
from balloon_warp.scene import Scene, SceneLike
from balloon_warp.scene.load import scene_of
from balloon_warp.system.api import Shown, checked, described
from balloon_warp.system.files import LINE, require_ours, sole_writer

Values = NDArray[np.float64]
NOISES = {"points": "noise", "volumes": "volume_noise", "pressures": "pressure_noise"}
"""Kinds of measured data, and names of the standard deviations of their noise"""
EXPECTED = "times, and points with particles, volumes or pressures of one balloon"


@dataclass(frozen=True)
class Measured:
    """Measures of one balloon at some times."""

    times: Values
    """Times [s], shape (t,)"""
    tracks: dict[str, Values]
    """Points, shape (t, m, 3); volumes, shape (t,); pressures, shape (t,)"""
    particles: NDArray[np.int64]
    """Particles of the points, shape (m,)"""
    noises: dict[str, float]
    """Standard deviations, where they are known"""
    balloon: int = 0

    def residuals(self, tracks: Mapping[str, Values], times: Values) -> Values:
        """Return the residuals of simulated worlds over the noise, shape (w, ...).

        Args:
            tracks: Simulated data of all frames, by name, shape (w, f, ...).
            times: Times of the frames [s], shape (f,).
        """
        after = np.clip(np.searchsorted(times, self.times), 1, len(times) - 1)
        share = (self.times - times[after - 1]) / (times[after] - times[after - 1])
        parts = []
        for name, wanted in self.tracks.items():
            track = tracks[name]
            part = share.reshape(-1, *[1] * (track.ndim - 2))
            there = (1.0 - part) * track[:, after - 1] + part * track[:, after]
            off = (there - wanted).reshape(len(track), -1)
            known = np.isfinite(wanted).ravel()  # hidden values are not numbers
            parts.append(off[:, known] / self.noises.get(name, 1.0))
        return np.concatenate(parts, axis=1)

    @property
    def noise_known(self) -> bool:
        """Return whether all measurements have a noise."""
        return set(self.tracks) <= set(self.noises)


def measured_of(data: str | Path | Mapping[str, Any], particle_count: int, last_time: float) -> Measured:
    """Read measurements: a .npz file, or a mapping, with `times` and the tracks at these times.

    Args:
        particle_count: of the scene's balloon.
        last_time: of the scene [s].

    Raises:
        InputError: it cannot be read, or is not of the scene.
    """
    source, table = ("data", dict(data)) if isinstance(data, Mapping) else (str(data), _read(Path(data)))
    tracks = {name: _numbers(source, name, table[name]) for name in NOISES if name in table}
    times = _numbers(source, "times", table.get("times", ()))
    if not len(times) or not tracks or times.ndim != 1:
        raise InputError(f"{source}: expected {EXPECTED} (got {', '.join(table) or 'nothing'})")
    if not (np.isfinite(times).all() and times.min() >= 0.0 and times.max() <= last_time * (1.0 + 1e-9)):
        raise InputError(f"{source}: times: expected from 0 to {last_time:g} s, the duration of the scene")
    particles = _numbers(source, "particles", table.get("particles", np.arange(particle_count))).astype(np.int64)
    if particles.ndim != 1 or (len(particles) and not 0 <= particles.min() <= particles.max() < particle_count):
        raise InputError(f"{source}: particles: expected numbers from 0 to {particle_count - 1}")
    for name, track in tracks.items():
        shape = (len(times), len(particles), 3) if name == "points" else (len(times),)
        if track.shape != shape:
            raise InputError(f"{source}: {name}: expected shape {shape} (got {track.shape})")
        if not np.isfinite(track).any():
            raise InputError(f"{source}: {name}: holds no number")
    noises = {name: _deviation(source, noise, table[noise]) for name, noise in NOISES.items() if noise in table}
    if len(tracks) > 1 and not set(tracks) <= set(noises):
        missing = " and ".join(NOISES[name] for name in tracks if name not in noises)
        raise InputError(f"{source}: {missing}: is missing; measures of several kinds are weighed by their noise")
    return Measured(times, tracks, particles, noises)


def _numbers(source: str, name: str, given: Any) -> Values:
    """Return an array of numbers.

    Raises:
        InputError: it is none.
    """
    try:
        return np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{source}: {name}: expected numbers (got {given!r:.60})") from None


def _deviation(source: str, name: str, given: Any) -> float:
    """Return a standard deviation.

    Raises:
        InputError: it is none.
    """
    number = _numbers(source, name, given)
    if number.size != 1 or not 0.0 < number.item() < np.inf:
        raise InputError(f"{source}: {name}: expected one standard deviation above 0 (got {given!r:.60})")
    return float(number.item())


def _read(path: Path) -> dict[str, Any]:
    try:
        with np.load(path, allow_pickle=False) as file:
            return {name: file[name] for name in file.files}
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; expected a .npz file of measured data") from None
    except Exception:  # for a damaged file zipfile, zlib and NumPy raise errors of a dozen kinds
        raise InputError(f"{path}: cannot be read; expected a .npz file with {EXPECTED}") from None


VAGUE = 0.05
"""Relative uncertainty above which a value is reported as vague"""
TWINS, MOST_TWINS = 0.98, 2
"""Correlation from which on two values can hardly be told apart, and most pairs that are named"""


@described
@dataclass(frozen=True, repr=False)
class Fit(Shown):
    """Values that explain measured data, with their uncertainties."""

    values: dict[str, float]
    """Values by path, or by name"""
    errors: dict[str, float]
    """Standard deviation of each, in its unit"""
    correlations: NDArray[np.float64]
    """Correlations of the errors, in the order of `values`, shape (n, n)"""
    misfit: float
    """Root mean square of the residuals, over the noise where that is known [1], else in the unit of the data"""
    noise_known: bool
    starts: NDArray[np.float64]
    """Misfit that each start reached, ascending"""
    at_bounds: dict[str, float] = field(default_factory=dict)
    """Bounds at which values lie, by path: the data may ask for values beyond"""
    remarks: tuple[str, ...] = ()
    """Sentences on the data and on how well the law has them"""
    derived: tuple[str, ...] = ()
    """Names of values that follow from the others"""

    @property
    def doubts(self) -> list[str]:
        """Sentences on values that are not well known."""
        names, said = list(self.values), [*self.remarks]
        vague = {
            name: f"{100.0 * abs(self.errors[name] / value):.2g}%"
            for name, value in self.values.items()
            if value and name not in self.at_bounds and abs(self.errors[name]) > VAGUE * abs(value)
        }
        if vague:
            said.append(
                f"{_listed(vague)} {'is' if len(vague) == 1 else 'are'} known to {_listed(vague.values())} only"
            )
        said += [f"{name} lies at its bound, {bound:.4g}" for name, bound in self.at_bounds.items()]
        twins = {
            (names[i], names[j]): float(self.correlations[i, j])
            for i, j in zip(*np.triu_indices(len(names), 1), strict=True)
            if abs(self.correlations[i, j]) > TWINS and not {names[i], names[j]} & set(self.derived)
        }
        if len(twins) > MOST_TWINS:
            largest = max(map(abs, twins.values()))
            return [*said, f"{len(twins)} pairs of values can hardly be told apart (correlations to {largest:.3f})"]
        return said + [
            f"{first} and {second} can hardly be told apart (correlation {correlation:.3f})"
            for (first, second), correlation in twins.items()
        ]

    def report(self) -> dict[str, Any]:
        """Return the fit's figures as JSON."""
        return {
            "values": self.values,
            "errors": self.errors,
            "correlations": self.correlations.tolist(),
            "misfit": self.misfit,
            "at_bounds": self.at_bounds,
            "doubts": self.doubts,
        }

    def __repr__(self) -> str:
        said = ", ".join(f"{name} {value:.6g} ± {self.errors[name]:.2g}" for name, value in self.values.items())
        return f"Fit({said}; misfit {self.misfit:.4g})"


class Residuals(NamedTuple):
    """Residuals of a fit: over the noise, or in the data's unit where that is not known."""

    jacobian: NDArray[np.float64]
    """Derivatives by the values, shape (m, n)"""
    misfit: float
    noise_known: bool


def fit_of(
    names: list[str], values: NDArray[np.float64], residuals: Residuals, starts: NDArray[np.float64],
    at_bounds: Mapping[str, float] | None = None, roughness: NDArray[np.float64] | None = None,
) -> Fit:  # fmt: skip
    """Return the fit of values with these residuals.

    Args:
        roughness: covariance of the values over the minima that jumps of the residuals leave, shape (n, n).
    """
    jacobian, misfit, noise_known = residuals
    size = np.maximum(np.abs(values), 1.0e-300)
    scaled = jacobian * size
    covariance = np.linalg.pinv(scaled.T @ scaled) * np.outer(size, size) * (1.0 if noise_known else misfit**2)
    if roughness is not None:
        covariance += roughness
    return fit_with(names, values, covariance, misfit, noise_known, starts, at_bounds)


def fit_with(
    names: list[str], values: NDArray[np.float64], covariance: NDArray[Any], misfit: float, noise_known: bool,
    starts: NDArray[np.float64], at_bounds: Mapping[str, float] | None = None,
) -> Fit:  # fmt: skip
    """Return the fit of values with this covariance, shape (n, n)."""
    size = np.maximum(np.abs(values), 1.0e-300)
    covariance = covariance / np.outer(size, size)
    deviations = np.sqrt(np.maximum(np.diag(covariance), 1.0e-300))
    return Fit(
        values=dict(zip(names, values.tolist(), strict=True)),
        errors=dict(zip(names, (deviations * size).tolist(), strict=True)),
        correlations=covariance / np.outer(deviations, deviations),
        misfit=misfit,
        noise_known=noise_known,
        starts=np.sort(starts),
        at_bounds=dict(at_bounds or {}),
    )


def _listed(words: Iterable[str]) -> str:
    *first, last = words
    return f"{', '.join(first)} and {last}" if first else last


MARK = np.array(LINE.encode())
"""Beginning of a file"""


class Journal:
    """A file of places and their residuals, round after round, below the request.

    Args:
        path: of the file.
        asked: by which the same fit is recognized.
        resume: whether to go on from the file.

    Raises:
        InputError: there is no such fit to resume, the file cannot be written, or somebody else's is in its place.
    """

    def __init__(self, path: Path, asked: Mapping[str, Any], resume: bool):
        self._path = path
        head = json.dumps(asked, sort_keys=True, default=str)
        self._known, end = _read_journal(path, head) if resume else ([], 0)
        require_ours(path)
        try:
            self._file = path.open("r+b" if resume else "wb")
            self._file.truncate(end)
            self._file.seek(end)
        except OSError as error:
            raise InputError(f"{path}: cannot be written: {error.strerror}") from None
        if not resume:
            self._write(MARK, np.array(head))

    @property
    def rounds(self) -> int:
        """Return how many rounds the file still has."""
        return len(self._known)

    def remembered(self, forward: Forward) -> Forward:
        """Return the function that answers from the file, and then simulates and writes down."""

        def answer(places: Values) -> Values:
            if self._known:
                asked, residuals = self._known.pop(0)
                if asked.shape == places.shape and (asked == places).all():
                    return residuals
                raise InputError(f"{self._path}: was written by a version with another search; expected the same")
            residuals = forward(places)
            self._write(places, residuals)
            return residuals

        return answer

    def close(self, done: bool) -> None:
        """Close the file, and remove it if the fit is done."""
        self._file.close()
        if done:
            self._path.unlink(missing_ok=True)

    def _write(self, *arrays: NDArray[Any]) -> None:
        for array in arrays:
            np.save(self._file, array, allow_pickle=False)
        self._file.flush()


def _read_journal(path: Path, head: str) -> tuple[list[tuple[Values, Values]], int]:
    """Return the rounds of a file, and where the last whole one ends.

    Raises:
        InputError: it is no such file, or of another fit.
    """
    rounds: list[tuple[Values, Values]] = []
    try:
        file = path.open("rb")
        np.load(file, allow_pickle=False)  # the mark
        told = str(np.load(file, allow_pickle=False))
    except (OSError, EOFError, ValueError):
        raise InputError(f"{path}: has no fit to --resume") from None
    with file:
        if told != head:
            raise InputError(f"{path}: has another fit; --resume needs the same data, scene and options")
        end = file.tell()
        try:
            while True:
                rounds.append((np.load(file, allow_pickle=False), np.load(file, allow_pickle=False)))
                end = file.tell()
        except (OSError, EOFError, ValueError):  # a kill may have cut the last one short
            return rounds, end


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
        list(bounds), values_at(bounds, best.place[None])[0], Residuals(best.jacobian / slopes, misfit, noise_known),
        np.sqrt(found.costs), at_bounds(bounds, best.place), rough,
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


Derive = Callable[..., Gradient]
"""Function of `of`, `vary` and `world_count`"""


@described
@dataclass(frozen=True, repr=False)
class Optimum(Shown):
    """Values for which a loss is least."""

    values: dict[str, float]
    """Values by path"""
    loss: float
    """Loss at the values"""
    starts: Values
    """Loss that each start reached, ascending; infinite where it could not be simulated"""
    evaluations: int
    """Number of times that all worlds were simulated"""
    without_influence: tuple[str, ...] = ()
    """Paths by which the loss did not change at all, wherever it was asked; their values are those of the start"""

    def __repr__(self) -> str:
        listed = ", ".join(f"{path}={value:.6g}" for path, value in self.values.items())
        return f"Optimum(loss {self.loss:.6g}: {listed})"


def least_loss(derive: Derive, bounds: Bounds, first: Values, rounds: int, on_stage: Callable[[str], None]) -> Optimum:
    """Return the least loss that some start came to.

    Args:
        first: places of the starts between the bounds, from 0 to 1, shape (n, p).

    Raises:
        InputError: no start can be simulated, or no value changes the loss.
    """
    on_stage(f"simulating {len(first)} worlds a round")
    influence = np.zeros(len(bounds), dtype=bool)

    def ask(places: Values) -> tuple[Values, Values]:
        losses, slopes = _derived(derive, bounds, values_at(bounds, places))
        begins = not influence.any()
        influence[:] |= slopes.any(axis=0)
        if begins and np.isfinite(losses).any():
            _tell_idle(_idle(bounds, influence), bounds, on_stage)
        of_places = [
            [slope_at(low, high, place) for (low, high), place in zip(bounds.values(), row, strict=True)]
            for row in places
        ]
        return losses, slopes * np.array(of_places)

    def on_round(number: int, loss: float) -> None:
        on_stage(f"round {number}: loss {loss:.4g}")

    places, asked = minima_together(ask, first, rounds, on_round)
    losses, _ = ask(places)
    if not np.isfinite(losses).any():
        raise InputError("of: none of the starts can be simulated; expected narrower bounds")
    best = int(np.argmin(losses))
    values = values_at(bounds, places[best : best + 1])[0]
    found = dict(zip(bounds, values.tolist(), strict=True))
    return Optimum(found, float(losses[best]), np.sort(losses), asked + 1, _idle(bounds, influence))


def _idle(bounds: Bounds, influence: NDArray[np.bool_]) -> tuple[str, ...]:
    """Return the paths without any influence so far."""
    return tuple(path for path, has in zip(bounds, influence, strict=True) if not has)


def _tell_idle(idle: Sequence[str], bounds: Bounds, on_stage: Callable[[str], None]) -> None:
    """Say which values do not change the loss at any start.

    Raises:
        InputError: none does.
    """
    if len(idle) == len(bounds):
        raise InputError(
            f"of: the loss depends on none of the values at any start: {', '.join(idle)}; expected a value that "
            "affects the loss"
        )
    if idle:
        on_stage(f"the loss does not depend on {', '.join(idle)} at any start")


def _derived(derive: Derive, bounds: Bounds, values: Values) -> tuple[Values, Values]:
    """Return losses and their derivatives of worlds; infinite and 0 of those that blow up."""
    try:
        return _of_worlds(derive, bounds, values)
    except BlowUpError:  # one world takes all with it: each by itself
        pass
    losses, slopes = np.full(len(values), np.inf), np.zeros(values.shape)
    for number in range(len(values)):
        try:
            one = _of_worlds(derive, bounds, values[number : number + 1])
            losses[number], slopes[number] = one[0][0], one[1][0]
        except BlowUpError:
            continue
    return losses, slopes


def _of_worlds(derive: Derive, bounds: Bounds, values: Values) -> tuple[Values, Values]:
    vary: dict[str, Any] = dict(zip(bounds, values.T, strict=True))
    found = derive(of=list(bounds), vary=vary, world_count=len(values))
    return found.loss, np.stack([found.gradients[path] for path in bounds], axis=1)


ROUNDS = 24


@overload
def fit(
    scene: SceneLike, data: str | Path | Mapping[str, Any], *, free: Mapping[str, tuple[float, float]],
    starts: int = ..., rounds: int = ..., seed: int = ..., progress: str | Path | None = ..., resume: bool = ...,
    device: str | None = ..., schedule: str = ..., laws: Sequence[Law] = ..., on_stage: Callable[[str], None] = ...,
) -> Fit: ...  # fmt: skip


@overload
def fit(
    scene: SceneLike, *, of: Mapping[str, tuple[float, float]], loss: Loss,
    starts: int = ..., rounds: int = ..., seed: int = ..., device: str | None = ..., schedule: str = ...,
    laws: Sequence[Law] = ..., on_stage: Callable[[str], None] = ...,
) -> Optimum: ...  # fmt: skip


@checked
def fit(
    scene: SceneLike,
    data: str | Path | Mapping[str, Any] | None = None,
    *,
    free: Mapping[str, tuple[float, float]] | None = None,
    of: Mapping[str, tuple[float, float]] | None = None,
    loss: Loss | None = None,
    starts: int = 8,
    rounds: int = ROUNDS,
    seed: int = 0,
    progress: str | Path | None = None,
    resume: bool = False,
    device: str | None = None,
    schedule: str = "auto",
    laws: Sequence[Law] = (),
    on_stage: Callable[[str], None] = lambda stage: None,
) -> Fit | Optimum:
    """Find the values of a scene that explain measured data, or for which a loss is least, from many starts.

    Measured data are explained by least squares: all starts, and all their differences, are worlds of one batch. A loss
    goes down along its gradients (L-BFGS-B of SciPy): all starts are worlds of one batch.

    Args:
        scene: Scene that was measured, with all that is known of it.
        data: A .npz file or a mapping: `times` [s], and then `points` with their `particles`, `volumes` or
            `pressures`, of the first balloon; `noise`, `volume_noise` and `pressure_noise` are standard deviations.
            Hidden points are NaN.
        free: With data: unknown values, as dotted paths, and the lowest and highest value.
        of: With a loss: the values to be found, as dotted paths, and the lowest and highest value.
        loss: As for `gradient`; `losses` has common ones.
        starts: Number of starting points.
        rounds: Largest number of steps.
        seed: Seed of the starting points.
        progress: With data: a file that keeps how far the fit is, and goes when it is done.
        resume: Go on from that file, where the same fit was stopped.
        device: A Warp device; if missing, the GPU or else the CPU.
        schedule: As for `simulate`, or with a loss as for `gradient`.
        laws: User-defined laws, besides the built-in ones.
        on_stage: Called with a few words at each stage.

    Raises:
        InputError: The data, a path or a bound is wrong, no start can be simulated, or there is nothing to resume.
    """
    scene = scene_of(scene)
    for name, number in (("starts", starts), ("rounds", rounds)):
        if number < 1:
            raise InputError(f"{name}: must be at least 1 (got {number})")
    if (data is None) == (loss is None):
        raise InputError("fit: expected either measured data and `free`, or a `loss` and `of`")
    if resume and progress is None:
        raise InputError("resume: needs the `progress` file of an earlier fit")
    if loss is not None:
        if progress is not None:
            raise InputError("progress: only fits to measured data save it; expected none with a `loss`")
        places = first_places(starts, len(checked_bounds("of", of)), seed)

        def derive(of: Sequence[str], vary: Vary, world_count: int) -> Gradient:
            return derived(scene, (), DerivativeRequest(of, loss, world_count, vary, device, schedule, laws))[0]

        return least_loss(derive, checked_bounds("of", of), places, rounds, on_stage)
    assert data is not None
    kept = None if progress is None else Path(progress)
    request = Request(checked_bounds("free", free), starts, rounds, seed, kept, resume)
    run = partial(simulate, device=device, schedule=schedule, laws=laws)
    return least_squares(run, scene, data, request, on_stage)
