"""The rubber of measured curves: least squares, lack of fit, and a plot."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import isfinite, log
from pathlib import Path
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont
from scipy.optimize import least_squares, root_scalar
from scipy.special import chdtrc, stdtrit

from balloon_warp.errors import InputError
from balloon_warp.kernels.laws.membrane import MEMBRANES, MOST_STRETCH, OGDEN_EXPONENTS
from balloon_warp.lab.fit.fit import Fit, fit_with
from balloon_warp.lab.fit.tables import Curve, Test
from balloon_warp.lab.statics import Balance, FilmSkin, SealedGas, Volume, determinant, metric_of
from balloon_warp.mesh.load import Treatment, load_mesh, prepared
from balloon_warp.model.materials import slopes_by_stretches
from balloon_warp.springs.build import build_membrane

Values = NDArray[np.float64]
Kind = Literal["neo_hookean", "mooney_rivlin", "gent", "ogden"]
KINDS: tuple[Kind, ...] = get_args(Kind)
EXPONENTS = (1.3, 5.0, -2.0)
"""Exponents of an Ogden material for rubber (Ogden 1972), where the data do not determine them"""
BOUNDS = {
    "shear_modulus": (1e-3, 1e12),
    "mooney_ratio": (1e-6, 1e3),
    "gent_limit": (1e-2, 1e6),
    "ogden_modulus": (1e-6, 1e12),
    "ogden_exponent": (0.2, OGDEN_EXPONENTS.most or 20.0),
    "radius": (1e-6, 1e3),
}
"""Least and largest sizes of values, by the beginning of their names"""
MODULI = tuple(f"ogden_modulus_{term}" for term in (1, 2, 3))


class Family(NamedTuple):
    """Values of a rubber that are fitted; all keep their signs."""

    names: tuple[str, ...]
    starts: tuple[tuple[float, ...], ...]
    """Values at which searches begin; their signs are kept"""


FAMILIES: dict[Kind, Family] = {
    "neo_hookean": Family(("shear_modulus",), ((3.0e5,),)),
    "mooney_rivlin": Family(("shear_modulus", "mooney_ratio"), ((3.0e5, 0.02), (3.0e5, 0.2))),
    "gent": Family(("shear_modulus", "gent_limit"), ((3.0e5, 20.0), (3.0e5, 60.0), (3.0e5, 150.0))),
    "ogden": Family(MODULI, ((6.0e5, 1.2e3, -1.0e4), (4.0e5, 3.0e3, -3.0e4))),
}
WITH_EXPONENTS = Family(
    (*MODULI, *(f"ogden_exponent_{term}" for term in (1, 2, 3))),
    (
        (6.3e5, 1.2e3, -1.0e4, 1.3, 5.0, -2.0),
        (4.0e5, 1.0e2, -5.0e3, 1.7, 7.0, -2.5),
        (1.0e6, 1.0e0, -1.0e4, 0.8, 10.0, -1.5),
        (3.0e5, 3.0e3, -1.0e5, 2.0, 4.0, -0.8),
    ),
)
"""An Ogden material whose exponents are fitted, too"""


def bounds_of(names: tuple[str, ...]) -> tuple[Values, Values]:
    """Return the least and the largest size of values."""
    bounds = [next(pair for start, pair in BOUNDS.items() if name.startswith(start)) for name in names]
    return np.array([least for least, _ in bounds]), np.array([most for _, most in bounds])


def law_numbers(kind: Kind, values: Values) -> dict[str, Any]:
    """Return the law's parameters of values, in the order of their names."""
    if kind == "ogden":
        exponents = values[3:6] if len(values) >= 6 else np.array(EXPONENTS)
        return {"ogden_moduli": np.array(values[:3]), "ogden_exponents": np.array(exponents)}
    most = {"most_stretch": max(MOST_STRETCH.default, 6.0)} if kind == "gent" else {}
    return dict(zip(FAMILIES[kind].names, map(float, values), strict=False)) | most


def shear_modulus_slopes(kind: Kind, values: Values) -> Values:
    """Return the derivatives of the shear modulus by the values, shape (n,)."""
    if kind != "ogden":
        return np.eye(len(values))[0]
    exponents = law_numbers(kind, values)["ogden_exponents"]
    return 0.5 * np.concatenate([exponents, values[:3]])[: len(values)]


def shear_modulus(kind: Kind, values: Values) -> float:
    """Return the shear modulus at rest [Pa]; for Ogden half the sum of moduli times exponents."""
    numbers = law_numbers(kind, values)
    return float(values[0] if kind != "ogden" else 0.5 * numbers["ogden_moduli"] @ numbers["ogden_exponents"])


def nominal_stresses(kind: Kind, values: Values, test: Test, stretches: Values) -> Values:
    """Return the stress over the area at rest of a strip or sheet, without stress through its thickness [Pa].

    A uniaxial test leaves the width free, a planar one keeps it, an equibiaxial one stretches it alike.
    """
    across = {"uniaxial": stretches**-0.5, "planar": np.ones(len(stretches))}.get(test, stretches)
    told = {name: np.full(1, each) if np.ndim(each) == 0 else each for name, each in law_numbers(kind, values).items()}
    slopes = slopes_by_stretches(MEMBRANES[kind], told, np.maximum(stretches, across), np.minimum(stretches, across))
    return np.where(stretches >= across, *slopes)


def sphere_pressures(kind: Kind, values: Values, volumes: Values, thickness: float, radius: float) -> Values:
    """Return the law of a thin sphere: 2 h / R W_1 / stretch^2 [Pa]."""
    stretches = (3.0 * volumes / (4.0 * np.pi)) ** (1.0 / 3.0) / radius
    return 2.0 * thickness / radius * nominal_stresses(kind, values, "equibiaxial", stretches) / stretches**2


def material_of(kind: Kind, values: Values, thickness: float) -> dict[str, Any]:
    """Return the material of a scene: its kind, its thickness [m] and its law's parameters by name."""
    numbers = {name: value for name, value in law_numbers(kind, values).items() if name != "most_stretch"}
    return {"kind": kind, "thickness": thickness} | {
        name: value.tolist() if np.ndim(value) else value for name, value in numbers.items()
    }


def material_table(material: dict[str, Any], thickness_known: bool) -> str:
    """Return the table of a scene file."""
    remarks = {} if thickness_known else {"thickness": "  # of your balloon: the tests do not tell it"}
    lines = [f"{name} = {_written(value)}{remarks.get(name, '')}\n" for name, value in material.items()]
    return "".join(["[balloon.material]\n", *lines])


def _written(value: Any) -> str:
    """Return a value of a table: a text, a number or a list of numbers, of six digits."""
    if isinstance(value, str):
        return f'"{value}"'
    return f"[{', '.join(map(_written, value))}]" if isinstance(value, list) else f"{value:.6g}"


class MeshCurve:
    """The curve of a mesh's balloon, by its statics; each asking begins where the last came to rest."""

    def __init__(self, path: Path, kind: Kind, thickness: float, volumes: Values):
        mesh = prepared(load_mesh(path), path, Treatment())
        self._volume, self._volumes = Volume(mesh), volumes
        self._kind: Kind = kind
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
        film, found = replace(self._film, numbers=law_numbers(self._kind, values)), np.full(len(self._volumes), 1.0e6)
        for row, volume in enumerate(self._volumes):
            points = self._points[row]
            slopes = self._volume.slopes(points)
            guess = -float((film.forces(points) * slopes).sum() / (slopes * slopes).sum())
            settled = Balance(film, self._volume, SealedGas.of(guess, volume)).settle(points)
            if settled is not None:
                self._points[row] = settled
                found[row] = SealedGas.of(guess, volume).pressure(self._volume.of(settled))
        return found


RUBBERS = (3.0e3, 3.0e7)
"""Shear moduli from the softest gels to hard rubber [Pa]"""
LARGE_MISFIT, SMALL_MISFIT, FEW_RUNS = 0.05, 0.005, -3.0
"""Misfit over the largest load above which a law does not fit, or does not with so few runs of one sign; and the
deviations from the mean number of runs from which on they are few"""
UNLIKELY = 1.0e-3
"""Probability of a misfit below which it is more than the deviations that were given"""


def lack_of_fit(
    residuals: Values, share: float, name: str = "the curve", load: str = "pressure", noise_known: bool = False
) -> list[str]:
    """Return a sentence if residuals, in the order of sizes, are no noise: too large, or of one sign for long.

    Args:
        residuals: measured less fitted loads, shape (n,).
        share: misfit over the largest load.
        name: of the curve.
        load: name of the load.
        noise_known: whether deviations are given, which then bound the misfit.
    """
    signs = residuals > 0.0
    above, count = int(signs.sum()), len(signs)
    below, runs = count - above, 1 + int(np.count_nonzero(signs[1:] != signs[:-1]))
    # Wald and Wolfowitz 1940: the number of runs in a random order
    mean = 1.0 + 2.0 * above * below / count
    variance = (mean - 1.0) * (mean - 2.0) / (count - 1.0)
    few = variance > 0.0 and (runs - mean) / np.sqrt(variance) < FEW_RUNS
    if (share > LARGE_MISFIT and not noise_known) or (few and share > SMALL_MISFIT):
        shape = f", and it lies above or below the rows for long ({runs} runs in {count} rows)" if few else ""
        return [f"the law misses {name} by {100.0 * share:.2g}% of its largest {load}{shape}: another kind may fit"]
    return []


def beyond_deviations(pulls: Values, freedom: float, name: str) -> list[str]:
    """Return a sentence if residuals are more than their deviations explain.

    Args:
        pulls: residuals over their deviations, shape (n,).
        freedom: rows less the values that they determine.
        name: of the curve.
    """
    squares = float(pulls @ pulls)
    if freedom <= 0.0 or chdtrc(freedom, squares) >= UNLIKELY:
        return []
    return [
        f"the law misses {name} by {np.sqrt(squares / freedom):.2g} times its deviations: another kind may fit, or "
        "they are too small"
    ]


def no_rubber(shear_modulus: float, inflated: bool) -> list[str]:
    """Return a sentence if no rubber has such a shear modulus [Pa]."""
    least, most = RUBBERS
    if least <= shear_modulus <= most:
        return []
    return [
        f"a shear modulus of {shear_modulus:.3g} Pa is no rubber's, {least:g} to {most:g} Pa: are the units right"
        f"{', and the thickness and the radius' if inflated else ''}?"
    ]


SIZE, MARGIN = (720, 480), (80, 24, 24, 56)
"""Size and margins [pixels]; left, top, right, bottom"""
PAPER, INK, FAINT = (255, 255, 255), (40, 40, 40), (225, 225, 225)
COLORS = (((40, 105, 160), (200, 60, 30)), ((60, 130, 60), (120, 60, 150)), ((150, 110, 20), (30, 120, 130)))
"""Colors of the line and the dots of each curve"""
TICKS = 5


def curves_plot(curves: Sequence[Curve], found: Sequence[Values]) -> Image.Image:
    """Draw loads over sizes: dots that were measured, and the lines that were found; inflations above other tests."""
    both = list(zip(curves, found, strict=True))
    parts = [[each for each in both if (each[0].test == "inflation") == inflated] for inflated in (True, False)]
    drawn = [_plot(part) for part in parts if part]
    image = Image.new("RGB", (SIZE[0], SIZE[1] * len(drawn)), PAPER)
    for number, part in enumerate(drawn):
        image.paste(part, (0, SIZE[1] * number))
    return image


def _plot(curves: Sequence[tuple[Curve, Values]]) -> Image.Image:
    image = Image.new("RGB", SIZE, PAPER)
    draw, font = ImageDraw.Draw(image), ImageFont.load_default(14)
    left, top, right, bottom = MARGIN
    inflated = curves[0][0].test == "inflation"
    sizes = np.concatenate([curve.sizes for curve, _ in curves])
    loads = np.concatenate([both for curve, found in curves for both in (curve.loads, found)])
    across = (0.0 if inflated else min(1.0, sizes.min()), 1.05 * sizes.max())
    up = (min(0.0, loads.min()), 1.1 * loads.max() if loads.max() > 0.0 else 0.0)

    def place(x: float, y: float) -> tuple[float, float]:
        return (
            left + (SIZE[0] - left - right) * (x - across[0]) / (across[1] - across[0]),
            SIZE[1] - bottom - (SIZE[1] - top - bottom) * (y - up[0]) / (up[1] - up[0]),
        )

    for x in ticks(*across):
        draw.line([place(x, up[0]), place(x, up[1])], FAINT)
        text = f"{1000.0 * x if inflated else x:.6g}"
        draw.text((place(x, up[0])[0], SIZE[1] - bottom + 6), text, INK, font, anchor="ma")
    for y in ticks(*up):
        draw.line([place(across[0], y), place(across[1], y)], FAINT)
        text = f"{y if inflated else 1e-6 * y:.6g}"
        draw.text((left - 8, place(across[0], y)[1]), text, INK, font, anchor="rm")
    draw.text((SIZE[0] // 2, SIZE[1] - 24), "volume [l]" if inflated else "stretch", INK, font, anchor="ma")
    what = "pressure [Pa]" if inflated else "nominal stress [MPa]"
    draw.text((8, 4), f"{what}: dots measured, line fitted", INK, font)
    for number, (curve, found) in enumerate(curves):
        line, dot = COLORS[number % len(COLORS)]
        draw.line(_joined([place(x, y) for x, y in zip(curve.sizes, found, strict=True)]), line, 3)
        for x, y in zip(curve.sizes, curve.loads, strict=True):
            (u, v), r = place(x, y), 4
            draw.ellipse((u - r, v - r, u + r, v + r), dot)
        if not inflated:
            draw.text((left + 12, top + 4 + 18 * number), curve.test, dot, font)
    return image


def ticks(low: float, high: float) -> list[float]:
    """Return round numbers of a range, a few."""
    rough = (high - low) / TICKS
    power = 10.0 ** np.floor(np.log10(rough))
    step = power * next(each for each in (1.0, 2.0, 5.0, 10.0) if each * power >= rough)
    return [float(k * step) for k in range(int(np.ceil(low / step)), int(np.floor(high / step)) + 1)]


def _joined(places: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    return [(float(u), float(v)) for u, v in places]


Function = Callable[[Values], Values]
ROUNDS, SETTLED = 8, 1.0e-2
"""Most rounds of weights that follow from slopes, and their relative change at the last one"""
EVALUATIONS = 300
LEAST_NOISE = 1.0e-4
"""Least noise of loads over their largest, where it is estimated"""
TWO_DEVIATIONS = 0.97725
"""Probability below two deviations of a normal distribution"""
UNSEEN = 1.0e-7
"""Singular value over the largest below which data do not determine a direction"""
MOST_LEVERAGE = 0.99
AT_BOUND = 0.01
"""Distance to a bound over the range between both, in logarithms, within which a value lies at it"""
WORST, TINY = 1.0e6, 1.0e-300


@dataclass(frozen=True)
class Rows:
    """Measured loads of all curves."""

    loads: Values
    """Loads [Pa], shape (n,)"""
    largest: Values
    """Largest load of the curve of each [Pa], shape (n,)"""
    load_deviations: Values | None
    """Standard deviations of the loads [Pa], shape (n,)"""
    size_deviations: Values | None
    """Standard deviations of the sizes, shape (n,)"""


@dataclass(frozen=True)
class Solution:
    """Values for which loads come nearest to measured ones."""

    names: tuple[str, ...]
    values: Values
    residuals: Values
    """Measured less fitted loads [Pa], shape (n,)"""
    pulls: Values
    """Residuals over the noise, shape (n,)"""
    jacobian: Values
    """Derivatives of loads over the noise by the logarithms of the values, shape (n, p)"""
    squares: float
    """Sum of the squares of the residuals, over the given noise or the largest loads"""
    starts: Values
    """Sums of all starts"""
    at_bounds: dict[str, float]
    """Bounds that values lie at"""


def solved(
    rows: Rows, loads: Function, slopes: Function, names: tuple[str, ...], starts: Sequence[Sequence[float]],
    bounds: tuple[Values, Values], on_stage: Callable[[str], None],
) -> Solution:  # fmt: skip
    """Find values by least squares of their logarithms, from all starts.

    Noise of sizes counts as that of loads times the slope of the curve, which follows from the fit: a few rounds. If
    only that noise is known, that of the loads is as large as the residuals ask for.

    Args:
        rows: measured loads, with their deviations.
        loads: function from values to loads, shape (n,).
        slopes: function from values to derivatives of loads by sizes, shape (n,).
        names: of the values.
        starts: values where searches begin; their signs are kept.
        bounds: least and largest sizes of the values.
        on_stage: called with a few words at each stage.
    """
    signs = np.sign(starts[0])
    given = rows.largest if rows.load_deviations is None else rows.load_deviations

    def residuals(logs: Values) -> Values:
        with np.errstate(all="ignore"):
            return rows.loads - loads(signs * np.exp(logs))

    found = []
    for number, start in enumerate(starts, start=1):
        on_stage(f"start {number} of {len(starts)}")
        found.append(_descent(residuals, np.log(np.abs(start)), given, bounds))
    costs = np.array([float(pulls @ pulls) for _, pulls, _ in found])
    logs, pulls, jacobian = found[int(np.argmin(costs))]
    noise = given
    for number in range(ROUNDS if rows.size_deviations is not None else 0):
        on_stage(f"weights {number + 1}")
        tilted = np.abs(slopes(signs * np.exp(logs))) * rows.size_deviations
        own = given
        if rows.load_deviations is None:
            own = rows.largest * _noise_left(residuals(logs), tilted, rows.largest, len(names))
        last, noise = noise, np.hypot(own, tilted)
        logs, pulls, jacobian = _descent(residuals, logs, noise, bounds)
        if np.allclose(last, noise, rtol=SETTLED, atol=0.0):
            break
    left = residuals(logs)
    counted = pulls if rows.load_deviations is not None else left / given
    ends = _at_bounds(names, logs, bounds)
    return Solution(names, signs * np.exp(logs), left, pulls, jacobian, float(counted @ counted), np.sort(costs), ends)


def _at_bounds(names: tuple[str, ...], logs: Values, bounds: tuple[Values, Values]) -> dict[str, float]:
    """Return the bounds that values came as near to as a descent does."""
    near = AT_BOUND * np.log(bounds[1] / bounds[0])
    return {
        name: float(bound[number])
        for bound in bounds
        for number, name in enumerate(names)
        if abs(logs[number] - np.log(bound[number])) < near[number]
    }


def _descent(
    residuals: Function, logs: Values, noise: Values, bounds: tuple[Values, Values]
) -> tuple[Values, Values, Values]:
    """Return the logarithms that a descent comes to, with residuals over the noise and the slopes of loads over it."""

    def pulls(logs: Values) -> Values:
        found = np.nan_to_num(residuals(logs) / noise, nan=WORST, posinf=WORST, neginf=-WORST)
        return np.clip(found, -WORST, WORST)

    least, most = np.log(bounds[0]), np.log(bounds[1])
    found = least_squares(pulls, logs, bounds=(least, most), diff_step=1e-5, x_scale=1.0, max_nfev=EVALUATIONS)
    return found.x, found.fun, -found.jac


def _noise_left(residuals: Values, tilted: Values, largest: Values, count: int) -> float:
    """Return the noise of loads over the largest that explains residuals beside that of sizes."""
    freedom = max(len(residuals) - count, 1)

    def excess(logarithm: float) -> float:
        return float((residuals**2 / (tilted**2 + (np.exp(logarithm) * largest) ** 2)).sum() - freedom)

    least, most = log(LEAST_NOISE), log(10.0 * max(float(np.abs(residuals / largest).max()), LEAST_NOISE) * freedom)
    return LEAST_NOISE if excess(least) <= 0.0 else float(np.exp(root_scalar(excess, bracket=(least, most)).root))


def covariance_of(found: Solution, trusted: bool) -> Values:
    """Return the covariance of the values, shape (p, p).

    Args:
        found: the solution.
        trusted: whether the noise of each row is known. Otherwise the residuals themselves tell it, row by row
            (MacKinnon and White 1985, HC3): it need not be alike for all rows. Student's factor for few rows is part of
            it, so that 95% of draws are within two deviations.
    """
    sizes = np.maximum(np.linalg.norm(found.jacobian, axis=0), TINY)
    left, singular, right = np.linalg.svd(found.jacobian / sizes, full_matrices=False)
    singular = np.maximum(singular, UNSEEN * singular[0])
    inverse = right.T / singular  # of J^T J, a root
    covariance = inverse @ inverse.T
    if not trusted:
        freedom = max(len(found.pulls) - len(found.names), 1)
        leverage = np.minimum((left**2).sum(axis=1), MOST_LEVERAGE)
        spread = inverse @ (left * (found.pulls / (1.0 - leverage))[:, None]).T
        unseen = inverse * (singular <= 2.0 * UNSEEN * singular[0])
        covariance = spread @ spread.T + unseen @ unseen.T * (found.pulls @ found.pulls / freedom)
        covariance *= (stdtrit(freedom, TWO_DEVIATIONS) / 2.0) ** 2
    scales = np.abs(found.values) / sizes
    return covariance * np.outer(scales, scales) * np.outer(np.sign(found.values), np.sign(found.values))


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
