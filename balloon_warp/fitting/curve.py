"""The rubber whose balloon had a measured curve of pressure over volume."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import isfinite
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from balloon_warp.errors import InputError
from balloon_warp.fitting.read_curve import Curve
from balloon_warp.fitting.result import Fit, fit_of
from balloon_warp.kernels.laws.membrane import MEMBRANES, MOST_STRETCH
from balloon_warp.mesh.load import load_mesh
from balloon_warp.mesh.prepare import Treatment, prepared
from balloon_warp.model.materials import slopes_by_stretches
from balloon_warp.springs.membrane import build_membrane
from balloon_warp.statics.balance import Balance
from balloon_warp.statics.film import FilmSkin, determinant, metric_of
from balloon_warp.statics.volume import SealedGas, Volume

Values = NDArray[np.float64]
Kind = Literal["mooney_rivlin", "gent", "ogden"]
EXPONENTS = (1.3, 5.0, -2.0)
"""Exponents of an Ogden material for rubber (Ogden 1972): its moduli are fitted"""
STARTS: dict[str, list[tuple[float, ...]]] = {
    "mooney_rivlin": [(3.0e5, 0.02), (3.0e5, 0.2)],
    "gent": [(3.0e5, 20.0), (3.0e5, 60.0), (3.0e5, 150.0)],
    "ogden": [(6.0e5, 1.2e3, 1.0e4), (4.0e5, 3.0e3, 3.0e4)],
}
RUBBERS = (3.0e3, 3.0e7)
"""Shear moduli from the softest gels to hard rubber [Pa]"""
LARGE_MISFIT, SMALL_MISFIT, FEW_RUNS = 0.05, 0.005, -3.0
"""Misfit over the largest pressure above which a law does not fit, or does not with so few runs of one sign; and the
deviations from the mean number of runs from which on they are few"""
NAMES = {
    "mooney_rivlin": ("shear_modulus", "mooney_ratio"),
    "gent": ("shear_modulus", "gent_limit"),
    "ogden": ("ogden_modulus_1", "ogden_modulus_2", "ogden_modulus_3"),
}


@dataclass(frozen=True)
class CurveFit:
    """The rubber, and the curve that it has."""

    fit: Fit
    pressures: Values
    """Fitted pressures at the measured volumes [Pa], shape (n,)"""
    toml: str
    """Table of a scene file"""


def fit_curve(
    curve: Curve,
    *,
    of: str | Path = "sphere",
    kind: Kind = "mooney_rivlin",
    thickness: float = 2.0e-4,
    radius: float | None = None,
    on_stage: Callable[[str], None] = lambda stage: None,
) -> CurveFit:
    """Find the rubber of a balloon by its curve of pressure over volume.

    Only the product of modulus and thickness is seen, so that the thickness must be known.

    Args:
        of: "sphere", whose formula is used, or the mesh of the balloon at rest, in meters.
        kind: of material. For "ogden" the moduli are fitted, with exponents 1.3, 5 and -2.
        thickness: at rest [m].
        radius: of the sphere at rest [m]; found, too, when missing.
        on_stage: told what is done.

    Raises:
        InputError: a number, a kind or the mesh cannot be.
    """
    if kind not in STARTS:
        raise InputError(f"kind: must be {', '.join(STARTS)} (got {kind!r})")
    for name, number in (("thickness", thickness), ("radius", 1.0 if radius is None else radius)):
        if not (isfinite(number) and number > 0.0):
            raise InputError(f"{name}: must be a number greater than 0 (got {number})")
    names, starts = list(NAMES[kind]), STARTS[kind]
    if str(of) == "sphere":
        fixed = radius
        if fixed is None:
            names.append("radius")
            least = (3.0 * curve.volumes[0] / (4.0 * np.pi)) ** (1.0 / 3.0)
            starts = [(*start, part * least) for start in starts for part in (0.6, 0.95)]

        def pressures(values: Values) -> Values:
            own = values[: len(NAMES[kind])]
            return sphere_pressures(kind, own, curve.volumes, thickness, fixed or float(values[-1]))

    else:
        pressures = MeshCurve(Path(of), kind, thickness, curve.volumes).pressures
        starts = starts[:2]
    return _fitted(curve, pressures, names, starts, kind, thickness, on_stage)


def sphere_pressures(kind: str, values: Values, volumes: Values, thickness: float, radius: float) -> Values:
    """Return the law of a thin sphere: 2 h / R W_1 / stretch^2 [Pa]."""
    stretches = (3.0 * volumes / (4.0 * np.pi)) ** (1.0 / 3.0) / radius
    told = {
        name: np.full(1, number) if np.ndim(number) == 0 else number for name, number in _numbers(kind, values).items()
    }
    first, _ = slopes_by_stretches(MEMBRANES[kind], told, stretches, stretches)
    return 2.0 * thickness / radius * first / stretches**2


class MeshCurve:
    """The curve of a mesh's balloon, by its statics; each asking begins where the last came to rest."""

    def __init__(self, path: Path, kind: str, thickness: float, volumes: Values):
        mesh = prepared(load_mesh(path), path, Treatment())
        self._volume, self._kind, self._volumes = Volume(mesh), kind, volumes
        if not 0.0 < self._volume.of(mesh.points) < volumes.max():
            raise InputError(
                f"{path}: encloses {self._volume.of(mesh.points):.3g} m^3 at rest; expected less than the measured "
                "volumes"
            )
        membrane = build_membrane(mesh)
        parts = membrane.areas / (0.5 * np.sqrt(determinant(metric_of(membrane.edges))))
        self._film = FilmSkin(MEMBRANES[kind], {}, membrane.corners, thickness * parts, membrane.edges)
        growth = (volumes / self._volume.of(mesh.points)) ** (1.0 / 3.0)
        self._points = [mesh.points * max(factor, 1.01) for factor in growth]

    def pressures(self, values: Values) -> Values:
        """Return the pressures at the volumes [Pa], shape (n,); NaN where there is no equilibrium."""
        film, found = replace(self._film, numbers=_numbers(self._kind, values)), np.full(len(self._volumes), 1.0e6)
        for row, volume in enumerate(self._volumes):
            points = self._points[row]
            slopes = self._volume.slopes(points)
            guess = -float((film.forces(points) * slopes).sum() / (slopes * slopes).sum())
            settled = Balance(film, self._volume, SealedGas.of(guess, volume)).settle(points)
            if settled is not None:
                self._points[row] = settled
                found[row] = SealedGas.of(guess, volume).pressure(self._volume.of(settled))
        return found


def _fitted(
    curve: Curve, pressures: Callable[[Values], Values], names: list[str], starts: list[tuple[float, ...]], kind: str,
    thickness: float, on_stage: Callable[[str], None],
) -> CurveFit:  # fmt: skip
    """Return the best of least squares from all starts, by logarithms."""
    unit = np.abs(curve.pressures).max()
    found = []
    for number, start in enumerate(starts, start=1):
        on_stage(f"start {number} of {len(starts)}")

        def off(logs: Values) -> Values:
            with np.errstate(all="ignore"):
                return np.nan_to_num(
                    (pressures(np.exp(logs)) - curve.pressures) / unit, nan=1e3, posinf=1e3, neginf=-1e3
                )

        found.append(least_squares(off, np.log(start), diff_step=1e-5, x_scale=1.0, max_nfev=60))
    best = min(found, key=lambda each: each.cost)
    values, free = np.exp(best.x), len(curve.volumes) - len(names)
    misfit = float(unit * np.sqrt(2.0 * best.cost / max(free, 1)))
    misfits = np.array([unit * np.sqrt(2.0 * each.cost / max(free, 1)) for each in found])
    found_pressures = pressures(values)
    fit = fit_of(names, values, unit * best.jac / values, misfit, False, misfits)
    lack = lack_of_fit(curve.pressures - found_pressures, misfit / unit)
    remarks = (*curve.remarks, *lack, *_no_rubber(kind, values))
    return CurveFit(replace(fit, remarks=remarks), found_pressures, _toml(kind, values, thickness))


def lack_of_fit(residuals: Values, share: float) -> list[str]:
    """Return a sentence if residuals, in the order of volumes, are no noise: too large, or of one sign for long.

    Args:
        residuals: measured less fitted pressures, shape (n,).
        share: misfit over the largest pressure.
    """
    signs = residuals > 0.0
    above, count = int(signs.sum()), len(signs)
    below, runs = count - above, 1 + int(np.count_nonzero(signs[1:] != signs[:-1]))
    # Wald and Wolfowitz 1940: the number of runs in a random order
    mean = 1.0 + 2.0 * above * below / count
    variance = (mean - 1.0) * (mean - 2.0) / (count - 1.0)
    few = variance > 0.0 and (runs - mean) / np.sqrt(variance) < FEW_RUNS
    if share > LARGE_MISFIT or (few and share > SMALL_MISFIT):
        shape = f", and it lies above or below the rows for long ({runs} runs in {count} rows)" if few else ""
        return [
            f"the law misses the curve by {100.0 * share:.2g}% of its largest pressure{shape}: another kind may fit"
        ]
    return []


def _no_rubber(kind: str, values: Values) -> list[str]:
    """Return a sentence if no rubber has such a shear modulus."""
    modulus = 0.5 * float(values[:3] @ np.abs(EXPONENTS)) if kind == "ogden" else float(values[0])
    least, most = RUBBERS
    if least <= modulus <= most:
        return []
    return [
        f"a shear modulus of {modulus:.3g} Pa is no rubber's, {least:g} to {most:g} Pa: are the units right, and the "
        "thickness and the radius?"
    ]


def _numbers(kind: str, values: Values) -> dict[str, Any]:
    """Return the law's parameters of what is fitted."""
    if kind == "ogden":
        moduli = np.array(values[:3]) * np.sign(EXPONENTS)
        return {"ogden_moduli": moduli, "ogden_exponents": np.array(EXPONENTS)}
    most = {"most_stretch": max(MOST_STRETCH.default, 6.0)} if kind == "gent" else {}
    return dict(zip(NAMES[kind], map(float, values), strict=False)) | most


def _toml(kind: str, values: Values, thickness: float) -> str:
    lines = ["[balloon.material]", f'kind = "{kind}"', f"thickness = {thickness:g}"]
    if kind == "ogden":
        moduli = ", ".join(f"{value:.6g}" for value in values[:3] * np.sign(EXPONENTS))
        lines += [f"ogden_moduli = [{moduli}]", f"ogden_exponents = {list(EXPONENTS)}"]
    else:
        lines += [f"{name} = {value:.6g}" for name, value in zip(NAMES[kind], values, strict=False)]
    return "\n".join(lines) + "\n"
