"""Laws, and the quantities that their functions may take.

A law is a Warp function that gives a force. Each of its arguments names a quantity given to its kind of law (below), or
one of its own parameters. A quantity that no law of a scene names is not computed.
"""

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from importlib import import_module
from pickle import PicklingError
from typing import Any, Literal, NamedTuple, Self

Kind = Literal["particle", "spring", "string", "hinge", "face", "membrane"]


class LawInput(NamedTuple):
    """Quantity given to laws of a kind."""

    name: str
    type: str
    meaning: str


_MOMENT = (
    LawInput("up", "vec3", "unit vector against gravity"),
    LawInput("step_seconds", "float", "length of the substep [s]"),
    LawInput("time", "float", "time since the start of the simulation [s]"),
)
_AIR = LawInput("air", "vec4", "velocity of the air there [m/s], and its density [kg/m^3]")
_PAIR = (
    LawInput("squared_length", "float", "|d|^2 [m^2], d from this end to the other; never 0"),
    LawInput("opening", "float", "d . d' [m^2/s], d' the rate of d: the spring lengthens at opening / |d|"),
    LawInput("rest_length", "float", "[m]"),
    LawInput("stiffness", "float", "spring constant k [N/m]"),
    LawInput("stiffness_times_length", "float", "k times the rest length [N]"),
)
LAW_INPUTS: Mapping[Kind, tuple[LawInput, ...]] = {
    "particle": (
        LawInput("position", "vec3", "[m]"),
        LawInput("velocity", "vec3", "[m/s]"),
        LawInput("mass", "float", "[kg]; 0 if pinned"),
        LawInput("mass_share", "float", "share of the balloon's mass"),
        LawInput("area_vector", "vec3", "gradient of the balloon's volume with respect to the position [m^2]"),
        LawInput("water_load", "vec4", "depth times area vector of the wetted faces [m^3], and their area [m^2]"),
        _AIR,
        *_MOMENT,
    ),
    "spring": (*_PAIR, *_MOMENT[1:]),
    "string": (*_PAIR, *_MOMENT[1:]),
    "hinge": (
        LawInput("role", "int", "0 and 1: the edge's ends a and b; 2 and 3: the corners beside it of the two faces"),
        LawInput("a", "vec3", "[m]"),
        LawInput("b", "vec3", "[m]"),
        LawInput("first", "vec3", "mean of the first face's corners beside the edge [m]"),
        LawInput("second", "vec3", "mean of the second face's corners beside the edge [m]"),
        LawInput("bend", "float", "angle between the two faces relative to that at rest [rad]"),
    ),
    "face": (
        LawInput("center", "vec3", "mean of the corners [m]"),
        LawInput("area_vector", "vec3", "area times the outer normal [m^2]"),
        LawInput("velocity", "vec3", "mean of the corners' velocities [m/s]"),
        _AIR,
        *_MOMENT,
    ),
    "membrane": (
        LawInput("trace", "float", "of C, see `laws.membrane`: the sum of the squared principal stretches"),
        LawInput("det", "float", "product of the squared principal stretches; never 0"),
        LawInput("spread", "float", "difference of the squared principal stretches"),
    ),
}
RESULT: Mapping[Kind, str] = {
    "particle": "vec3",  # the force on the particle [N]
    "spring": "float",  # force per unit displacement [N/m]: the force on this end is that times d, on the other minus
    "string": "float",  # the same, on a particle that a fixed anchor holds
    "hinge": "vec3",  # the force on the place that the role names [N]; a wing's corners share theirs
    "face": "vec3",  # the force on the face [N], which its corners share alike
    "membrane": "two",  # slopes of the energy by trace and determinant [Pa]
}
"""Return type of a law of each kind"""


FAR = 1.0e12
"""Number larger in magnitude than all numbers of a scene"""
TINY = 1.0e-12
"""Least divisor, whose square does not vanish in float32"""


@dataclass(frozen=True)
class Parameter:
    """A number that a scene has for each world, or for each balloon, sphere, string, tube or outer force.

    Its unit, bounds, default and place in scene files all follow from this one row. Parameters of your own laws belong
    to the world or to balloons.
    """

    name: str
    unit: str
    default: float = 0.0
    """Default value"""
    least: float = -FAR
    most: float = FAR
    of: Literal["world", "balloon", "sphere", "string", "obstacle", "body", "tube", "force"] = "balloon"
    meaning: str = ""
    path: str = ""
    """Path in a scene, or in a balloon or sphere of it; when empty, the parameter is in the table `law.NAME` of its law
    or phase"""
    size: int = 1
    """3 for a vector"""
    absent: float | None = None
    """Value where the scene lacks the table of the parameter; the default, when missing"""
    domain: tuple[float, float] | None = None
    """Range of usual values, from which tests draw; when missing, values about the default, or within the bounds"""

    def placed(self, owner: str) -> Self:
        """Return the row with a path, where it has none: in the table of the law or phase of that name."""
        return self if self.path else replace(self, path=f"law.{owner}.{self.name}")


_OF_PARTICLE_AT_REST = (
    LawInput("mass", "float", "the particle's [kg]"),
    LawInput("mass_share", "float", "share of the balloon's mass"),
    LawInput("area", "float", "share of the balloon's area [m^2]: twice that at the start, since it may grow"),
    LawInput("velocity", "vec3", "[m/s]; 0 at the start"),
)
INPUTS_OF_BOUNDS: Mapping[Kind, tuple[LawInput, ...]] = {
    "particle": _OF_PARTICLE_AT_REST,
    "spring": (LawInput("stiffness", "float", "spring constant k [N/m]"),),
    "string": (LawInput("stiffness", "float", "spring constant k [N/m]"),),
    "hinge": (),
    "membrane": (),
    "face": _OF_PARTICLE_AT_REST,  # which a face's bound is shared out to, in proportion to the area
}
"""Quantities given to the bounds of each kind, besides all parameters"""


@dataclass(frozen=True, eq=False)
class Law:
    """A law of the simulation.

    Its bounds, `stiffness` and `drag`, are Python functions from which the stable step follows. The names of their
    arguments are those of their inputs: `INPUTS_OF_BOUNDS`, and parameters. They get arrays that broadcast: worlds
    first, then particles, and a vector's three numbers last. Without bounds the step of "auto" does not take the law
    into account.
    """

    kind: Kind
    force: Any
    """Force, a `wp.func`; see `LAW_INPUTS` for its arguments and `RESULT` for its return type"""
    parameters: tuple[Parameter, ...] = ()
    """Rows of the law's parameters, each with a path"""
    name: str = ""
    """Name of the law; the function's name, when empty"""
    energy: Any = None
    """Energy [J], a `wp.func` of the force's arguments, whose negative gradient is the force; None if there is none"""
    linear: bool = False
    """Whether a membrane's energy is linear in I1 - 3: the derivative by the trace is then constant, and that by the
    determinant is minus this over det^2"""
    neutral: Mapping[str, float] = field(default_factory=dict)
    """Values of parameters at which the law vanishes and is left out"""
    wants: Callable[..., bool] | None = None
    """Predicate of a scene, whether the law belongs to it; all scenes, when missing"""
    stiffness: Callable[..., Any] | None = None
    """Bound on the derivative of the force by position [N/m], of a pair's force by distance, of a hinge's moment by
    angle [N m/rad]; 0 when missing"""
    drag: Callable[..., Any] | None = None
    """Bound on the derivative of the force by velocity [N s/m], of a pair's force by its rate of lengthening; 0 when
    missing"""
    resistance: Any = None
    """Coefficient k of the part `-k |v| v` of a particle's force [kg/m], a `wp.func` of such arguments as the force's.
    A step takes that part at the speed of its end, see `phases.motion.resist`, so that it asks for no `drag`"""

    def __post_init__(self) -> None:
        if not self.name:
            object.__setattr__(self, "name", self.force.key.rpartition(".")[2])
        object.__setattr__(self, "parameters", tuple(row.placed(self.name) for row in self.parameters))

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[str, str]]:
        """Pickle a law as its name in the module of its function."""
        module = self.force.func.__module__
        names = [name for name, value in vars(sys.modules[module]).items() if value is self]
        if not names or module == "__main__":
            raise PicklingError(
                f"law {self.name}: other processes cannot find it; expected a global name for it in the module of its "
                f"function, {module}, other than a script or a notebook"
            )
        return _law_named, (module, names[0])


def _law_named(module: str, name: str) -> Law:
    return getattr(import_module(module), name)
