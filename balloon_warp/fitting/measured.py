"""Measured motion of a balloon."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError

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
