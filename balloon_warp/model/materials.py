"""Balloons of rubber or film: masses, stiffness, and tears."""

from collections.abc import Mapping, Sequence
from functools import cache
from types import FunctionType, SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.kernels.laws import Law
from balloon_warp.kernels.laws.air import DRY_AIR_MOLAR_MASS
from balloon_warp.kernels.laws.membrane import (
    BRANCHING,
    MEMBRANES,
    PARAMETERS,
    RAYLEIGH,
    SOFTENING_PARAMETERS,
    TEARING,
    steepening,
)
from balloon_warp.model.parameters import Parameters
from balloon_warp.model.shape import BalloonShape
from balloon_warp.scene import Scene
from balloon_warp.springs import SpringKind

Values = NDArray[np.float64]
STATES = 13
"""Number of stretches sampled each way"""
LEAST_STRETCH = 0.8
"""Least stretch of materials without wrinkles for which the step is made; squeezed further they stiffen without
limit"""
MOST_UNEVEN = 3.0
"""Largest ratio of the two stretches at which the larger one reaches the limit: under uniaxial tension the material is
so thin that some materials are several times as stiff across as anything else in a balloon"""
VERGE, STIFF = 1.78, 1.5
"""Factor on the modulus where stiffness jumps, on the verge of wrinkling, and the most stretch of a film that never
leaves it: there the step of "auto", 0.8 of the stable one, is 1.2 / omega. A spring that pulls and does not push gains
energy in longer ones, though each of its sides alone is stable up to 2 / omega. Rubber leaves the verge, and grows
softer, as soon as it is inflated"""
APART = 1.0e-3
"""Least difference of a state's two stretches, so that quotients of differences are defined"""
STEP = 1.0e-5
"""Step of finite differences"""
NODES, WEIGHTS = np.polynomial.legendre.leggauss(12)
"""Quadrature of the integral from rest to a state"""
OF_ARRAYS = SimpleNamespace(log=np.log, max=np.maximum, pow=np.power, sqrt=np.sqrt, where=np.where)
"""NumPy counterparts of the Warp functions that laws call"""
NAMES = frozenset(row.name for row in (*PARAMETERS, *SOFTENING_PARAMETERS))
"""Parameters that the step of a membrane depends on"""


def law_of(scene: Scene, number: int) -> Law | None:
    """Return the law of a balloon's membrane; None if the balloon is made of springs."""
    return MEMBRANES.get(scene.balloon[number].material.law)


def settle_masses(scene: Scene, shapes: Sequence[BalloonShape], parameters: Parameters) -> Values:
    """Return masses [kg], shape (W, balloon_count): for rubber and film, rest area times thickness and density."""
    masses = parameters["mass"]
    for number, shape in enumerate(shapes):
        if law_of(scene, number):
            own = parameters["thickness"][:, number] * parameters["initial_density"][:, number]
            own = own * shape.membrane.areas.sum()
            masses = np.broadcast_to(masses, (max(len(masses), len(own)), masses.shape[1])).copy()
            masses[:, number] = own
    return masses


def numbers_of(parameters: Mapping[str, Values], number: int) -> dict[str, Values]:
    """Return the parameters of a balloon's material, each of shape (W, 1), a vector's of shape (3, W, 1)."""
    rows = {row.name: parameters[row.name][:, number] for row in (*PARAMETERS, *SOFTENING_PARAMETERS)}
    return {name: values.T[..., None] if values.ndim > 1 else values[:, None] for name, values in rows.items()}


@cache
def on_arrays(function: Any) -> FunctionType:
    """Return a function of Warp as one of arrays, in float64: NumPy's functions take the place of Warp's."""
    plain = function.func
    called = {name: value for name, value in plain.__globals__.items() if name in plain.__code__.co_names}
    called = {name: on_arrays(value) if isinstance(value, wp.Function) else value for name, value in called.items()}
    return FunctionType(plain.__code__, {**called, "wp": OF_ARRAYS})


def slopes_by_stretches(law: Law, told: Mapping[str, Values], first: Values, second: Values) -> tuple[Values, Values]:
    """Return the derivatives of the energy density by the principal stretches [Pa], the first not the smaller."""
    major, minor = first * first, second * second
    invariants = {"trace": major + minor, "det": major * minor, "spread": major - minor}
    slopes = on_arrays(law.force)
    names = slopes.__code__.co_varnames[: slopes.__code__.co_argcount]
    by_trace, by_det = slopes(**{name: {**told, **invariants}[name] for name in names})
    return 2.0 * first * (by_trace + by_det * minor), 2.0 * second * (by_trace + by_det * major)


def steepest_softening(law: Law, told: Mapping[str, Values], first: Values, second: Values) -> Values:
    """Return the largest derivative of the softening factor by the energy density [1/Pa]."""
    if not told["softening"].any():
        return np.zeros(1)
    energy = np.zeros(np.broadcast_shapes(first.shape, told["softening"].shape))
    for node, weight in zip(0.5 * (NODES + 1.0), 0.5 * WEIGHTS, strict=True):  # along the straight way from rest
        w1, w2 = slopes_by_stretches(law, told, 1.0 + node * (first - 1.0), 1.0 + node * (second - 1.0))
        energy = energy + weight * (w1 * (first - 1.0) + w2 * (second - 1.0))
    return steepening(np.maximum(energy, 0.0), *(told[row.name] for row in SOFTENING_PARAMETERS))


def stiffest_modulus(law: Law, told: Mapping[str, Values]) -> Values:
    """Return the stiffest modulus over all states that count [Pa], shape (W,).

    It bounds the energy's second derivative by the deformation gradient, at rest, and by more where it jumps.

    States are the taut ones up to the most stretch, not too uneven, or without wrinkles all down to the least. A
    multiple of the determinant may be subtracted from a state's second derivative: its integral depends on the border
    alone, and so it gives no force within.
    """
    most, wrinkles = told["most_stretch"], told["wrinkling"] != 0.0
    steps = np.linspace(0.0, 1.0, STATES)
    least = np.where(wrinkles, 1.0, LEAST_STRETCH) * (1.0 + APART)
    first = (least * (np.maximum(most, least) / least) ** steps)[:, :, None]
    lowest = np.maximum(np.where(wrinkles[:, :, None], first**-0.5, LEAST_STRETCH), first / MOST_UNEVEN)
    highest = (1.0 - APART) * first
    second = np.minimum(lowest * (highest / lowest) ** steps, highest).reshape(len(first), -1)
    first = np.broadcast_to(first, (*first.shape[:2], STATES)).reshape(len(first), -1)

    def slopes(a: Any, b: Any) -> tuple[Values, Values]:
        return slopes_by_stretches(law, told, a, b)

    w1, w2 = slopes(first, second)
    # where it begins to give way, the energy's slopes fall, too, with the energy itself
    giving_way = steepest_softening(law, told, first, second) * (w1 * w1 + w2 * w2)
    up, down = slopes(first + STEP, second), slopes(first - STEP, second)
    w11, w12 = ((upper - lower) / (2.0 * STEP) for upper, lower in zip(up, down, strict=True))
    w22 = (slopes(first, second + STEP)[1] - slopes(first, second - STEP)[1]) / (2.0 * STEP)
    shear, spin = (w1 - w2) / (first - second), (w1 + w2) / (first + second)
    best = np.full(w1.shape, np.inf)
    for part in np.linspace(0.0, 1.0, 9):
        taken = part * w12
        stretching = 0.5 * (w11 + w22) + np.hypot(0.5 * (w11 - w22), w12 - taken)
        best = np.minimum(best, np.maximum(stretching, np.maximum(shear + taken, spin - taken)))
    aside = np.maximum(w1 / first, w2 / second)
    verge = wrinkles & (most <= STIFF) & (second * np.sqrt(first) <= 1.0 + APART)
    return (np.maximum(best + giving_way, aside) * np.where(verge, VERGE, 1.0)).max(axis=1)


def thickest_viscosity(told: Mapping[str, Values]) -> Values:
    """Return the largest viscosity [Pa s], shape (W,): 4 eta over the square of the least stretch that counts."""
    least = np.where(told["wrinkling"] != 0.0, told["most_stretch"] ** -0.5, LEAST_STRETCH)
    return (4.0 * told["film_viscosity"] / least**2)[:, 0]


INCOMPRESSIBLE = 0.5
"""Poisson's ratio of rubber and film here"""


class SheetStiffness(NamedTuple):
    """Stiffness of a sheet."""

    stretch: float
    """Uniaxial stiffness at constant width [N/m]: E h / (1 - nu^2)"""
    shear: float
    """Shear stiffness [N/m]: G h"""
    bend: float
    """Bending stiffness of a plate [N m]: E h^3 / (12 (1 - nu^2))"""


def youngs_modulus(law: Law, parameters: Mapping[str, NDArray[Any]], number: int) -> float:
    """Return Young's modulus of a balloon's rubber or film in the first world, at rest [Pa].

    At a small equibiaxial strain, an incompressible material has a stress of E / (1 - 1/2) times the strain.
    """
    told = numbers_of(parameters, number)
    up, down = (slopes_by_stretches(law, told, *2 * (np.array([1.0 + step]),))[0] for step in (STEP, -STEP))
    return (1.0 - INCOMPRESSIBLE) * float((up - down).flat[0]) / (2.0 * STEP)


def sheet_of_springs(shape: BalloonShape, parameters: Mapping[str, NDArray[Any]], number: int) -> SheetStiffness | None:
    """Return the sheet that a balloon's springs make in the first world, or None where they have no surface.

    All of it is taken to follow the mean strain (Cauchy and Born). Springs then have an energy of 1/2 k (L e)^2 each, e
    the strain along them. Where they lie alike in all directions, S the sum of k L^2 over the area, the stiffness is
    3/8 S one way and 1/8 S in shear, and Poisson's ratio of the sheet a third (Ostoja-Starzewski 2002, Lattice models
    in micromechanics). In any arrangement the equibiaxial stiffness is their sum S/2, which a balloon swells against.
    Hinges make a plate the same way, with the width L of the two faces that a hinge bends by L for each unit of
    curvature. Springs across thin parts are left out.
    """
    if not shape.area > 0.0:
        return None
    constants = np.array([parameters[kind.name.lower()][0, number] for kind in SpringKind])
    of_each = constants[shape.springs.kind] * shape.stiffness_scale
    if shape.across is not None:
        of_each = np.where(shape.across, 0.0, of_each)
    pulled = float(of_each @ shape.springs.rest_lengths**2) / shape.area
    bent = float(parameters["torsion"][0, number]) * float((_hinge_widths(shape) ** 2).sum()) / shape.area
    return SheetStiffness(stretch=0.375 * pulled, shear=0.125 * pulled, bend=0.375 * bent)


def _hinge_widths(shape: BalloonShape) -> NDArray[np.float64]:
    """Return half of how far its wings are from each edge, together [m]; shape (hinge_count,)."""
    edge, *wings = shape.hinges.arms(shape.mesh.points)
    lengths = np.maximum(np.linalg.norm(edge, axis=1), np.finfo(float).tiny)
    first, second = (np.linalg.norm(np.cross(edge, wing), axis=1) for wing in wings)
    return 0.5 * (first + second) / lengths


GAMMA_OF_AIR = 1.4


def settle_tears(scene: Scene, parameters: Mapping[str, Values]) -> dict[str, Values]:
    """Return the defaults of tears: stresses at which they advance and branch, and their speed.

    Also the gas that leaves a balloon with a given pressure: air, adiabatic.

    Raises:
        InputError: a balloon that may burst has something that would not burst with it.
    """
    _require_bursting_alone(scene, parameters)
    strength, density = parameters["film_strength"], parameters["initial_density"]
    shear = parameters["shear_modulus"]
    of_terms = 0.5 * (parameters["ogden_moduli"] * parameters["ogden_exponents"]).sum(axis=-1)
    is_ogden = np.array([balloon.material.law == "ogden" for balloon in scene.balloon])
    speed = RAYLEIGH * np.sqrt(np.where(is_ogden, of_terms, shear) / density)
    automatic = {"tear_strength": TEARING * strength, "branching_stress": BRANCHING * strength, "tear_speed": speed}
    settled = {name: np.where(np.isnan(parameters[name]), values, parameters[name])
               for name, values in automatic.items()}  # fmt: skip
    given = np.array([balloon.inflation.kind != "gas" and balloon.material.strength is not None
                      for balloon in scene.balloon])  # fmt: skip
    for name, of_air in {"molar_mass": DRY_AIR_MOLAR_MASS, "gamma": GAMMA_OF_AIR}.items():
        settled[name] = np.where(given, of_air, parameters[name])
    return settled


def _require_bursting_alone(scene: Scene, parameters: Mapping[str, Values]) -> None:
    may_burst = {number for number, balloon in enumerate(scene.balloon) if balloon.material.strength is not None}
    for number in may_burst:
        balloon = scene.balloon[number]
        named = f"balloon.{number}.material.strength: a balloon that may burst"
        if balloon.stiffness.torsion:
            raise InputError(f"{named} cannot have torsion springs, which hold tears together (got stiffness.torsion)")
        if balloon.material.springs:
            _require_struts(scene, number, parameters["yield_stretch"][:, number])
        if balloon.neck:
            raise InputError(f"{named} cannot have an open neck (got neck); expected one or the other")
        if balloon.inflation.kind == "normal_force":
            raise InputError(f'{named} needs a pressure or gas (got inflation.kind = "normal_force")')
    for number, tube in enumerate(scene.tube):
        if joined := may_burst & set(tube.balloons):
            raise InputError(f"tube.{number}: joins balloon {min(joined)}, which may burst; expected one or the other")
    if may_burst and scene.touches:
        raise InputError(
            "touch: balloons that may burst (material.strength) cannot touch others; expected one or the other"
        )
    if may_burst and scene.water:
        raise InputError("water: balloons that may burst (material.strength) cannot float; expected one or the other")


def _require_struts(scene: Scene, number: int, yield_stretches: Values) -> None:
    """Refuse springs that pull in a balloon that may tear, since they would go on across a tear."""
    if yield_stretches.max() > 1.0:
        raise InputError(
            f"balloon.{number}.material.springs: pull, and would hold a tear together; expected "
            "stiffness.yield_stretch = 1, so that they only push, or no springs beside a strength"
        )
    if scene.correction != "none":
        raise InputError(
            f"correction: shortens springs of balloon {number}, whose material tears, and would hold a tear together "
            f'(got "{scene.correction}"); expected "none"'
        )
