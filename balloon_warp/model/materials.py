"""Balloons of rubber or film: masses, stiffness and tears, and the sums of laws' bounds around each particle."""

import inspect
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from types import FunctionType, SimpleNamespace
from typing import Any, Literal, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.kernels.laws import Law, columns_of
from balloon_warp.kernels.laws.air import DRY_AIR_MOLAR_MASS
from balloon_warp.kernels.laws.law import Kind
from balloon_warp.kernels.laws.membrane import (
    BRANCHING,
    MEMBRANES,
    PARAMETERS,
    RAYLEIGH,
    SOFTENING_PARAMETERS,
    TEARING,
    steepening,
)
from balloon_warp.kernels.laws.springs import KINDS
from balloon_warp.model.parameters import Parameters
from balloon_warp.model.shape import BalloonShape, Surroundings
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


def resolve_masses(scene: Scene, shapes: Sequence[BalloonShape], parameters: Parameters) -> Values:
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


def resolve_tears(scene: Scene, parameters: Mapping[str, Values]) -> dict[str, Values]:
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


Bound = Literal["stiffness", "drag"]
CHUNK = 1_000_000
"""Number of entries processed together, to bound the memory"""


class Stiffest(NamedTuple):
    """Bounds of a balloon's stiffness over its mass, in all its worlds [1/s^2]."""

    springs: NDArray[np.float64]
    """Bound of a spring of each kind, and its increase in proportion to the spring's scale, shape (3, 2)"""
    held: NDArray[np.float64]
    """Bound of everything else, at each moving particle, shape (P,)"""
    membrane: float
    """Bound of a membrane, as springs whose constants are those of its Laplacian"""


class Bounds:
    """The bounds of one balloon's laws, by the springs, strings, hinges and faces around its particles.

    Args:
        scene: whose laws count.
        laws: among which they are.
        number: the balloon.
        parameters: of all worlds.
        touch: contribution of contacts to the sums of stiffness and of drag, shape (W,) each, see `model.touch`.
    """

    def __init__(
        self,
        scene: Scene,
        laws: Sequence[Law],
        number: int,
        parameters: Parameters,
        touch: Mapping[Bound, NDArray[np.float64]] | None = None,
    ):
        columns = columns_of(laws)
        self._laws = [law for law in laws if law.wants is None or law.wants(scene)]
        self._told = {row.name: parameters[row.name][:, number, None] for row in columns.balloon}
        self._told |= {row.name: parameters[row.name][:, None] for row in columns.world}
        strings = [place for place, string in enumerate(scene.string) if string.balloon == number]
        self._strings = parameters["string_stiffness"][:, strings]
        self._ends = [0.5 if scene.string[place].body is None else 1.0 for place in strings]
        """Weights of strings: one from an anchor that does not give way counts half, as a force on a single particle"""
        self._touch = touch or {}
        self._membrane = membrane_bounds(scene, number, parameters)
        self._world_count = max(
            len(v) for v in (*self._told.values(), self._strings, *self._touch.values(), *self._membrane.values())
        )

    @property
    def has_hinges(self) -> bool:
        """Return whether any law of hinges is stiff in any world."""
        return any(np.any(bound(**self._told)) for bound in self._of_kind("hinge", "stiffness"))

    def largest(self, bound: Bound, around: Surroundings) -> NDArray[np.float64]:
        """Return the largest of the particles' sums over their mass shares, shape (world_count,).

        Shape (1,) if nothing differs between worlds. Twice the sum over the balloon's mass is Gershgorin's bound of the
        network. A pair whose other end is fixed counts half, and so does a force on a single particle.
        """
        at_once = max(CHUNK // max(around.particle_count, 1), 1)
        largest = np.zeros(self._world_count)
        for begin in range(0, self._world_count, at_once):
            worlds = slice(begin, begin + at_once)
            sums = self.sums(bound, around, worlds) / around.mass_share
            largest[worlds] = np.max(sums, axis=1, initial=0.0)
        return largest

    def sums(self, bound: Bound, around: Surroundings, worlds: slice) -> NDArray[np.float64]:
        """Return the sum of the laws' bounds at each particle, shape (worlds, P) or (1, P)."""
        total = self._other_sums(bound, around, worlds)
        if bound in self._membrane:
            total = total + _some(self._membrane[bound], worlds)[:, None] * around.membrane
        for kind, least, more in self._spring_constants(bound, worlds):
            if np.any(least):
                total = total + least * around.spring_counts[:, kind]
            total = total + more * around.spring_scales[:, kind]
        return total

    def stiffest(self, around: Surroundings, masses: NDArray[np.float64]) -> "Stiffest":
        """Return upper bounds over all worlds.

        Args:
            masses: Masses of the balloon in each world [kg], shape (world_count,) or (1,).
        """
        springs = np.zeros((len(KINDS), 2))
        for kind, *parts in self._spring_constants("stiffness", slice(None)):
            springs[kind] += [np.max(part / masses[:, None]) for part in parts]
        at_once = max(CHUNK // max(around.particle_count, 1), 1)
        held = np.zeros(around.particle_count)
        for begin in range(0, self._world_count, at_once):
            worlds = slice(begin, begin + at_once)
            sums = self._other_sums("stiffness", around, worlds)
            over = masses[worlds] if len(masses) > 1 else masses
            held = np.maximum(held, np.max(2.0 * sums / over[:, None], axis=0))
        membrane = np.max(self._membrane.get("stiffness", np.zeros(1)) / masses)
        return Stiffest(springs, held, float(membrane))

    def of_strings(self, bound: Bound, worlds: slice = slice(None)) -> NDArray[np.float64]:
        """Return the sum of the laws' bounds at each of the balloon's strings, shape (worlds, count of them)."""
        told = {name: _some(values, worlds) for name, values in self._told.items()}
        strings = _some(self._strings, worlds)
        total = np.zeros_like(strings)
        for of_string in self._of_kind("string", bound):
            total = total + of_string(**told | {"stiffness": strings})
        return total

    def _spring_constants(self, bound: Bound, worlds: slice) -> Iterator[tuple[int, Any, Any]]:
        """Iterate over laws and kinds of springs with their constant bound, and its increase with a spring's scale."""
        told = {name: values[worlds] if len(values) > 1 else values for name, values in self._told.items()}
        for of_spring in self._of_kind("spring", bound):
            for kind, row in enumerate(KINDS):  # terms not proportional to the constant remain where that is 0
                least, most = (of_spring(**told | {"stiffness": scale * told[row.name]}) for scale in (0.0, 1.0))
                yield kind, least, most - least

    def _other_sums(self, bound: Bound, around: Surroundings, worlds: slice) -> NDArray[np.float64]:
        """Return the sum of the bounds of all laws but those of springs, and of contacts."""
        told = {name: _some(values, worlds) for name, values in self._told.items()}
        total = np.zeros((1, around.particle_count))
        for place, (end, held) in enumerate(zip(self._ends, self.of_strings(bound, worlds).T, strict=True)):
            total = total + end * held[:, None] * around.strings[:, place]
        for of_hinge in self._of_kind("hinge", bound):
            total = total + of_hinge(**told) * around.hinges
        told |= {"mass_share": around.mass_share, "area": around.area, "velocity": around.velocity}
        told["mass"] = told["mass"] * around.mass_share
        for kind in ("particle", "face"):
            for of_one in self._of_kind(kind, bound):
                total = total + 0.5 * of_one(**told)
        if bound in self._touch:
            each = _some(self._touch[bound][:, None], worlds)
            total = total + (each if bound == "stiffness" else each * np.sqrt(around.mass_share))
        return total

    def _of_kind(self, kind: Kind, bound: Bound) -> Iterator[Callable[..., Any]]:
        for law in self._laws:
            if law.kind == kind and getattr(law, bound) is not None:
                yield ignoring_other_arguments(getattr(law, bound))


def membrane_bounds(scene: Scene, number: int, parameters: Parameters) -> dict[Bound, NDArray[np.float64]]:
    """Return a membrane's bounds in all worlds, shape (W,).

    The stiffest modulus [N/m] and viscosity [N s/m], times its thickness; empty for a balloon of springs.
    """
    law = law_of(scene, number)
    if law is None:
        return {}
    told = numbers_of(parameters, number)
    thickness = told["thickness"][:, 0]
    return {"stiffness": stiffest_modulus(law, told) * thickness, "drag": thickest_viscosity(told) * thickness}


def _some(values: NDArray[np.float64], worlds: slice) -> NDArray[np.float64]:
    """Return the rows of some worlds, or the one row of all."""
    return values[worlds] if len(values) > 1 else values


def ignoring_other_arguments(bound: Callable[..., Any]) -> Callable[..., Any]:
    """Return the function wrapped so that it ignores arguments it does not name."""
    names = names_of(bound)
    return lambda **told: bound(**{name: told[name] for name in names})


@cache
def names_of(bound: Callable[..., Any] | None) -> set[str]:
    """Return the names of the arguments of a law's bound."""
    return set(inspect.signature(bound).parameters) if bound else set()


def names_of_bounds(laws: Sequence[Law]) -> set[str]:
    """Return the names of the arguments of these laws' bounds."""
    return {name for law in laws for bound in (law.stiffness, law.drag) for name in names_of(bound)}
