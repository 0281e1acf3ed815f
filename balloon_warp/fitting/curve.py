"""The rubber that measured curves are of: inflations, and tests of strips and sheets."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.fitting.lack import beyond_deviations, lack_of_fit, no_rubber
from balloon_warp.fitting.measured_curve import Curve
from balloon_warp.fitting.mesh_curve import MeshCurve
from balloon_warp.fitting.result import Fit, fit_with
from balloon_warp.fitting.rubber import (
    FAMILIES,
    KINDS,
    WITH_EXPONENTS,
    Family,
    Kind,
    bounds_of,
    material_of,
    material_table,
    nominal_stresses,
    shear_modulus,
    shear_modulus_slopes,
    sphere_pressures,
)
from balloon_warp.fitting.weighted import Rows, Solution, covariance_of, solved

Values = NDArray[np.float64]
PARTS_OF_RADIUS = (0.6, 0.95)
"""Radius at rest over that of the smallest volume, where searches begin"""
STEP = 1.0e-4
"""Relative step of sizes in differences of loads"""
RESOLUTION = 1.0e-4
"""Misfit over the largest load below which laws are equally good"""


@dataclass(frozen=True)
class CurveFit:
    """The rubber, and the curves that it has."""

    fit: Fit
    loads: list[Values]
    """Fitted loads at the measured sizes of each curve [Pa], shape (n,)"""
    material: dict[str, Any]
    """The material of a scene: its kind, thickness [m], and parameters by name"""
    thickness_known: bool
    """Whether the curves have an inflation, which determines the modulus only with this thickness"""
    unit: str
    """Description of the misfit, in words"""

    @property
    def toml(self) -> str:
        """Table of a scene file."""
        return material_table(self.material, self.thickness_known)

    def report(self) -> dict[str, Any]:
        """Return the fit's figures and the material as JSON."""
        told = {"misfit_unit": self.unit, "material": self.material, "thickness_known": self.thickness_known}
        return self.fit.report() | told


def fit_curves(
    curves: Sequence[Curve],
    *,
    of: str | Path = "sphere",
    kind: Kind = "mooney_rivlin",
    thickness: float = 2.0e-4,
    radius: float | None = None,
    on_stage: Callable[[str], None] = lambda stage: None,
) -> CurveFit:
    """Find the rubber that all curves are of.

    An inflation determines only the product of modulus and thickness over the radius, so that the thickness must be
    known; tests of strips and sheets determine the modulus. Rows are weighed by their deviations, where they are given;
    otherwise each curve counts relative to its largest load.

    Args:
        curves: all of one rubber.
        of: the inflated body: "sphere", whose formula is used, or the mesh of the balloon at rest, in meters.
        kind: of material. The exponents of "ogden" are fitted if the data determine them (Akaike's criterion), and
            otherwise, and for a mesh, 1.3, 5 and -2.
        thickness: at rest [m].
        radius: of the sphere at rest [m]; found, too, when missing.
        on_stage: called with a few words at each stage.

    Raises:
        InputError: a number, a kind, the mesh or the curves together cannot be.
    """
    if kind not in KINDS:
        raise InputError(f"kind: must be {', '.join(KINDS)} (got {kind!r})")
    for name, number in (("thickness", thickness), ("radius", 1.0 if radius is None else radius)):
        if not (isfinite(number) and number > 0.0):
            raise InputError(f"{name}: must be a number greater than 0 (got {number})")
    model = _Model(curves, str(of), kind, thickness, radius)
    rows = Rows(
        np.concatenate([curve.loads for curve in curves]),
        np.concatenate([np.full(len(curve.loads), np.abs(curve.loads).max()) for curve in curves]),
        _load_deviations(curves),
        _size_deviations(curves),
    )
    found = _best(model, rows, on_stage)
    return _result(model, rows, found, thickness)


class _Model:
    """Loads of a kind of rubber at the sizes of all curves."""

    def __init__(self, curves: Sequence[Curve], of: str, kind: Kind, thickness: float, radius: float | None):
        self.curves, self.of_sphere = curves, of == "sphere"
        self.kind: Kind = kind
        self.inflations = [curve for curve in curves if curve.test == "inflation"]
        self.finds_radius = bool(self.inflations) and self.of_sphere and radius is None
        self._thickness, self._radius = thickness, radius
        self._meshes: dict[int, MeshCurve] = {}
        if not self.of_sphere:
            if not self.inflations:
                raise InputError(f"of: {of} tells the shape of an inflation; expected none for tests of stress")
            for number, curve in enumerate(curves):
                if curve.of_sphere:
                    raise InputError(f"{curve.name}: a diameter is that of a sphere; expected volumes with --of {of}")
                if curve.test == "inflation":
                    self._meshes[number] = MeshCurve(Path(of), kind, thickness, curve.sizes)

    def families(self) -> list[Family]:
        """Return the families of rubber that may be fitted, the simplest first."""
        families = [FAMILIES[self.kind]]
        if self.kind == "ogden" and self.of_sphere:
            families.append(WITH_EXPONENTS)
        if not self.of_sphere:
            families = [Family(families[0].names, families[0].starts[:2])]
        if self.finds_radius:
            least = min((3.0 * curve.sizes[0] / (4.0 * np.pi)) ** (1.0 / 3.0) for curve in self.inflations)
            families = [
                Family(
                    (*names, "radius"), tuple((*start, part * least) for start in starts for part in PARTS_OF_RADIUS)
                )
                for names, starts in families
            ]
        return families

    def own(self, values: Values) -> Values:
        """Return the values of the rubber."""
        return values[:-1] if self.finds_radius else values

    def of_each(self, values: Values) -> list[Values]:
        """Return the loads of each curve [Pa]."""
        return [self._of(number, curve.sizes, values) for number, curve in enumerate(self.curves)]

    def loads(self, values: Values) -> Values:
        """Return the loads of all curves [Pa], shape (n,)."""
        return np.concatenate(self.of_each(values))

    def slopes(self, values: Values) -> Values:
        """Return the derivatives of loads by sizes, shape (n,); for a mesh along its rows."""
        slopes = []
        for number, curve in enumerate(self.curves):
            if number in self._meshes:
                with np.errstate(all="ignore"):  # rows of one volume have none
                    found = np.gradient(self._of(number, curve.sizes, values), curve.sizes)
                slopes.append(np.nan_to_num(found, nan=0.0, posinf=0.0, neginf=0.0))
            else:
                higher, lower = (self._of(number, curve.sizes * factor, values) for factor in (1.0 + STEP, 1.0 - STEP))
                slopes.append((higher - lower) / (2.0 * STEP * curve.sizes))
        return np.concatenate(slopes)

    def _of(self, number: int, sizes: Values, values: Values) -> Values:
        """Return the loads of a curve at sizes [Pa]; a mesh has only those that were measured."""
        own, test = self.own(values), self.curves[number].test
        if number in self._meshes:
            return self._meshes[number].pressures(own)
        if test == "inflation":
            return sphere_pressures(self.kind, own, sizes, self._thickness, self._radius or float(values[-1]))
        return nominal_stresses(self.kind, own, test, sizes)


def _load_deviations(curves: Sequence[Curve]) -> Values | None:
    """Return the deviations of all loads, where they are known.

    Raises:
        InputError: some curves have them, and others do not.
    """
    without = [curve.name for curve in curves if curve.load_deviations is None]
    known = [curve.load_deviations for curve in curves if curve.load_deviations is not None]
    if known and without:
        raise InputError(
            f"{without[0]}: has no deviations of its loads, but others have; expected them for all curves, or none"
        )
    return np.concatenate(known) if known else None


def _size_deviations(curves: Sequence[Curve]) -> Values | None:
    """Return the deviations of all sizes, 0 where they are not known; None if none is."""
    if all(curve.size_deviations is None for curve in curves):
        return None
    return np.concatenate(
        [np.zeros(len(curve.sizes)) if curve.size_deviations is None else curve.size_deviations for curve in curves]
    )


def _best(model: _Model, rows: Rows, on_stage: Callable[[str], None]) -> Solution:
    """Return the best solution; of one with more values only if the data determine them."""
    best: Solution | None = None
    for family in model.families():
        count = len(family.names)
        if best is not None and len(rows.loads) < count + 3:
            break
        found = solved(rows, model.loads, model.slopes, family.names, family.starts, bounds_of(family.names), on_stage)
        if best is None or _criterion(found, rows) < _criterion(best, rows):
            best = found
    assert best is not None
    return best


def _criterion(found: Solution, rows: Rows) -> float:
    """Return Akaike's criterion for few rows (Hurvich and Tsai 1989)."""
    count, free = len(rows.loads), len(found.names)
    if rows.load_deviations is not None:
        likelihood = float(found.pulls @ found.pulls)
    else:
        likelihood = count * np.log(np.mean((found.residuals / rows.largest) ** 2) + RESOLUTION**2)
    return likelihood + 2.0 * free + 2.0 * free * (free + 1.0) / max(count - free - 1.0, 1e-9)


def _result(model: _Model, rows: Rows, found: Solution, thickness: float) -> CurveFit:
    curves, own, names = model.curves, model.own(found.values), list(found.names)
    remarks = [remark for curve in curves for remark in curve.remarks]
    free, noise_known = max(len(rows.loads) - len(names), 1), rows.load_deviations is not None
    loads, begin, excess = model.of_each(found.values), 0, []
    for curve, fitted in zip(curves, loads, strict=True):
        here = slice(begin, begin := begin + len(curve.loads))
        freedom = free * len(curve.loads) / len(rows.loads)
        residuals = curve.loads - fitted
        share = np.sqrt(residuals @ residuals / freedom) / np.abs(curve.loads).max()
        if noise_known:
            excess += beyond_deviations(found.pulls[here], freedom, curve.name)
        remarks += lack_of_fit(residuals, float(share), curve.name, curve.load_name, noise_known)
    remarks += [*excess, *no_rubber(shear_modulus(model.kind, own), bool(model.inflations))]
    covariance = covariance_of(found, trusted=noise_known and not excess)
    values, derived = found.values, ()
    if model.kind == "ogden":  # the modulus of all its values together
        more = np.zeros(len(values))
        more[: len(own)] = shear_modulus_slopes(model.kind, own)
        spread = np.vstack([more, np.eye(len(values))])
        covariance, values = spread @ covariance @ spread.T, np.append(shear_modulus(model.kind, own), values)
        derived = ("shear_modulus",)
        names = [*derived, *names]
    scale, unit = (1.0, "times the deviations") if noise_known else (100.0, "% of the largest load")
    if not noise_known and len(curves) == 1:
        scale, unit = float(rows.largest[0]), "Pa"
    misfit = scale * np.sqrt(found.squares / free)
    starts = scale * np.sqrt(found.starts / free)
    fit = fit_with(names, values, covariance, float(misfit), noise_known, starts, found.at_bounds)
    fit = replace(fit, remarks=tuple(remarks), derived=derived)
    return CurveFit(fit, loads, material_of(model.kind, own, thickness), bool(model.inflations), unit)
