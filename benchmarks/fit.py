"""Accuracy of fits.

Run it by python -m balloon_warp.benchmarks.fit [curve] [flight] [cuda:0] [SEED ...].

Curves of rubber have noise of 1% of their top, and 300 draws of it. A flight is one second of a latex balloon that
spins, trembles and bounces: half of its points are hidden, and those that are seen are 2 mm off. Each seed has other
noise, other hidden points and other starts.
"""

import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

import balloon_warp as bw
from balloon_warp.lab.fit.curve import Kind, fit_curves, sphere_pressures
from balloon_warp.lab.fit.fit import Fit
from balloon_warp.lab.fit.tables import Curve
from balloon_warp.mesh.topology import quad_sphere
from balloon_warp.system.warp_setup import quiet_warp

Values = NDArray[np.float64]
DRAWS, SEEDS, STARTS = 300, 20, 4
RADIUS, THICKNESS, CURVE_NOISE = 0.05, 2.0e-4, 0.01
RUBBERS: dict[str, dict[str, float]] = {
    "mooney_rivlin": {"shear_modulus": 3.3e5, "mooney_ratio": 0.1},
    "gent": {"shear_modulus": 3.3e5, "gent_limit": 97.2},
}
TRUE = {
    "balloon.material.shear_modulus": 3.3e5,
    "balloon.material.thickness": 2.0e-4,
    "balloon.inflation.moles": 0.2,
    "balloon.drag_coefficient": 0.47,
}
FREE = {
    "balloon.material.shear_modulus": (1.0e5, 1.0e6),
    "balloon.material.thickness": (1.0e-4, 5.0e-4),
    "balloon.inflation.moles": (0.05, 0.4),
    "balloon.drag_coefficient": (0.1, 1.0),
}
FIRST, LAST = 18, 78
"""frames that are seen of a flight: filled after 0.2 s, watched from 0.3 to 1.3 s"""
POINT_NOISE, HIDDEN = 0.002, 0.5
CELLS = 4
"""along an edge of the egg's mesh, which has 98 vertices"""


@dataclass(frozen=True)
class CurveRow:
    """Errors of fits to so many rows of a rubber's curve."""

    kind: str
    rows: int
    within: Values
    """of each value, the error that 95% of the draws are below [1]"""
    bound: Values
    """of each value, the least error of any method without bias (Cramer and Rao) [1]"""
    covered: tuple[Values, Values]
    """of each value, the fraction of draws within one and two reported standard deviations [1]"""
    seconds: float

    def __str__(self) -> str:
        parts = [
            f"{name} {100.0 * within:.2f}% ({100.0 * bound:.2f}%)"
            for name, within, bound in zip(RUBBERS[self.kind], self.within, self.bound, strict=True)
        ]
        return f"| {self.kind} | {self.rows} | {', '.join(parts)} | {percents(self.covered)} | {self.seconds:.0f} |"


def covered(pulls: Values) -> tuple[Values, Values]:
    """Return the fractions of draws within one and two standard deviations, of each value.

    Args:
        pulls: Errors over the reported standard deviations, shape (draws, values).
    """
    return (np.abs(pulls) < 1.0).mean(axis=0), (np.abs(pulls) < 2.0).mean(axis=0)


def percents(covered: tuple[Values, Values]) -> str:
    """Return fractions within one and two standard deviations in words."""
    return ", ".join(f"{100.0 * one:.0f}% / {100.0 * two:.0f}%" for one, two in zip(*covered, strict=True))


def curve(kind: str, rows: int, draws: int = DRAWS) -> CurveRow:
    """Fit a rubber to its curve up to a stretch of 5, with other noise each time."""
    began, true = time.perf_counter(), np.array(list(RUBBERS[kind].values()))
    volumes = 4.0 / 3.0 * np.pi * RADIUS**3 * np.linspace(1.05, 5.0, rows) ** 3
    pressures = sphere_pressures(cast(Kind, kind), true, volumes, THICKNESS, RADIUS)
    deviation, off, pulls = CURVE_NOISE * pressures.max(), [], []
    for seed in range(draws):
        noisy = pressures + deviation * np.random.default_rng(seed).standard_normal(rows)
        fit = fit_curves([Curve(volumes, noisy)], kind=cast(Kind, kind), thickness=THICKNESS, radius=RADIUS).fit
        missed = np.array(list(fit.values.values())) - true
        off.append(np.abs(missed / true))
        pulls.append(missed / np.array(list(fit.errors.values())))
    slopes = [
        (sphere_pressures(cast(Kind, kind), true * (1.0 + step), volumes, THICKNESS, RADIUS) - pressures)
        / (1e-6 * deviation)
        for step in 1e-6 * np.eye(len(true))
    ]
    bound = 1.96 * np.sqrt(np.diag(np.linalg.inv(np.array(slopes) @ np.array(slopes).T)))
    within, seconds = np.percentile(off, 95.0, axis=0), time.perf_counter() - began
    return CurveRow(kind, rows, within, bound, covered(np.array(pulls)), seconds)


@dataclass(frozen=True)
class FlightRow:
    """Result of a seed."""

    seed: int
    fit: Fit
    seconds: float

    @property
    def off(self) -> dict[str, float]:
        """Relative error of each value [1]."""
        return {path: self.fit.values[path] / true - 1.0 for path, true in TRUE.items()}

    def __str__(self) -> str:
        off = " | ".join(f"{100.0 * each:+.3f}% ({100.0 * self.error(path):.2f})" for path, each in self.off.items())
        return f"| {self.seed} | {off} | {self.fit.misfit:.4f} | {self.seconds:.0f} |"

    def error(self, path: str) -> float:
        """Return the standard deviation that is told, over the true value [1]."""
        return self.fit.errors[path] / TRUE[path]


def flight(seed: int, cells: int = CELLS, device: str = "cpu", starts: int = STARTS) -> FlightRow:
    """Fit a scene to a flight that was seen.

    Args:
        seed: of the noise, of the hidden points and of the starts.
        cells: along an edge of the egg's mesh.
        device: that worlds are simulated on; the true flight is one on a CPU.
        starts: of the search.
    """
    began = time.perf_counter()
    fit = bw.fit(flying(cells), seen(seed, cells), free=FREE, starts=starts, seed=seed, device=device)
    return FlightRow(seed, fit, time.perf_counter() - began)


def flying(cells: int = CELLS) -> bw.Scene:
    """Return the scene of an egg of latex that is filled, spins, and bounces off the ground."""
    ball = quad_sphere(cells, 1.0)
    points = ball.points / np.linalg.norm(ball.points, axis=1)[:, None] * [1.0, 1.0, 1.5] * RADIUS
    balloon = bw.Balloon(
        mesh=replace(ball, points=points, name="egg"), parts="free", holes="keep", damping=0.0, drag_coefficient=0.47,
        velocity=(4.0, 3.0, 0.0), angular_velocity=(3.0, 0.0, 6.0),
        material=bw.Material(preset="latex", viscosity=20.0, most_stretch=3.5),
        inflation=bw.Inflation(moles=0.2, fill_time=0.2, molar_mass=0.029, breathing_damping=0.0),
    )  # fmt: skip
    return bw.Scene(balloon=[balloon], ground=bw.Ground(height=-0.3), frames=LAST)


def seen(seed: int, cells: int = CELLS) -> dict[str, Any]:
    """Return the noisy observations of the true flight."""
    times, points = _true_flight(cells)
    rng = np.random.default_rng(seed)
    particles = np.flatnonzero(rng.random(points.shape[1]) < 1.0 - HIDDEN)
    noisy = points[:, particles] + POINT_NOISE * rng.standard_normal((len(times), len(particles), 3))
    return {"times": times, "points": noisy, "particles": particles, "noise": POINT_NOISE}


@cache
def _true_flight(cells: int) -> tuple[Values, Values]:
    moved = bw.simulate(bw.load_scene(flying(cells), TRUE), device="cpu")
    return moved.times[FIRST:], moved.points[0][FIRST:].astype(np.float64)


def _curves() -> Iterator[str]:
    yield "| law | rows | 95% of draws are nearer than (what no method without bias comes below) | in 1 / 2 sd | s |"
    yield "|---|---|---|---|---|"
    for kind in RUBBERS:
        for rows in (20, 150):
            yield str(curve(kind, rows))


def _flights(seeds: list[int], device: str) -> Iterator[str]:
    names = [path.rpartition(".")[2] for path in TRUE]
    yield f"| seed | {' | '.join(f'{name} (1 sd)' for name in names)} | misfit | s |"
    yield f"|---|{'---|' * len(names)}---|---|"
    rows = []
    for seed in seeds:
        rows.append(flight(seed, device=device))
        yield str(rows[-1])
    off = np.abs([list(row.off.values()) for row in rows])
    pulls = np.array([[each / row.error(path) for path, each in row.off.items()] for row in rows])
    yield f"| within 1 / 2 sd | {percents(covered(pulls)).replace(', ', ' | ')} | | |"
    yield f"| worst | {' | '.join(f'{100.0 * each:.3f}%' for each in off.max(axis=0))} | | |"
    yield f"| median | {' | '.join(f'{100.0 * each:.3f}%' for each in np.median(off, axis=0))} | | |"


if __name__ == "__main__":
    quiet_warp()
    asked, numbers = (
        [word for word in sys.argv[1:] if not word.isdigit()],
        [int(w) for w in sys.argv[1:] if w.isdigit()],
    )
    kinds, devices = {"curve", "flight"} & set(asked), [word for word in asked if word.startswith(("cpu", "cuda"))]
    if "curve" in kinds or not kinds:
        print(*_curves(), sep="\n")
    if "flight" in kinds or not kinds:
        for line in _flights(numbers or list(range(SEEDS)), devices[0] if devices else "cpu"):
            print(line, flush=True)
