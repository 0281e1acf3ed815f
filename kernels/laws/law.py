"""What a law is, and what it may ask for.

A law is a function of Warp that gives a force. It names what it needs: each of its arguments is one of the things that
its kind of law is told (below), or one of its own parameters. What no law of a scene names is not computed.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

Kind = Literal["particle", "spring", "string", "hinge", "face"]


class Given(NamedTuple):
    """Something that laws of a kind are told."""

    name: str
    type: str
    meaning: str


_MOMENT = (
    Given("up", "vec3", "unit vector against gravity"),
    Given("step_seconds", "float", "length of the substep [s]"),
    Given("time", "float", "since the simulation began [s]"),
)
_PAIR = (
    Given("squared_length", "float", "|d|^2 [m^2], d from this end to the other; never 0"),
    Given("opening", "float", "d . d' [m^2/s], d' how fast d changes: it lengthens by opening / |d| each second"),
    Given("rest_length", "float", "[m]"),
    Given("stiffness", "float", "its spring constant k [N/m]"),
    Given("stiffness_times_length", "float", "k times its rest length [N]"),
)
GIVEN: Mapping[Kind, tuple[Given, ...]] = {
    "particle": (
        Given("position", "vec3", "[m]"),
        Given("velocity", "vec3", "[m/s]"),
        Given("mass", "float", "[kg]; 0 if it is fixed"),
        Given("mass_share", "float", "its part of the balloon's mass"),
        Given("area_vector", "vec3", "gradient of the balloon's volume by its place [m^2]"),
        Given("water_load", "vec4", "depth times area vector of its wetted faces [m^3], and their area [m^2]"),
        *_MOMENT,
    ),
    "spring": (*_PAIR, *_MOMENT[1:]),
    "string": (*_PAIR, *_MOMENT[1:]),
    "hinge": (
        Given("role", "int", "0 and 1: the edge's ends a and b; 2 and 3: the corners beside it of the two faces"),
        Given("a", "vec3", "[m]"),
        Given("b", "vec3", "[m]"),
        Given("first", "vec3", "mean of the first face's corners beside the edge [m]"),
        Given("second", "vec3", "and of the second's [m]"),
        Given("rest_angle", "float", "between the two faces [rad]"),
    ),
    "face": (
        Given("center", "vec3", "mean of its corners [m]"),
        Given("area_vector", "vec3", "its area along its outer normal [m^2]"),
        Given("velocity", "vec3", "mean of its corners' [m/s]"),
        *_MOMENT,
    ),
}
RESULT: Mapping[Kind, str] = {
    "particle": "vec3",  # the force on the particle [N]
    "spring": "float",  # force per unit displacement [N/m]: the force on this end is that times d, on the other minus
    "string": "float",  # the same, on a particle that a fixed anchor holds
    "hinge": "vec3",  # the force on the place that the role names [N]; a wing's corners share theirs
    "face": "vec3",  # the force on the face [N], which its corners share alike
}
"""what a law of each kind returns"""


@dataclass(frozen=True)
class Parameter:
    """A number that a law has for each balloon, or for each world: one row, from which all else follows."""

    name: str
    unit: str
    default: float = 0.0
    least: float = -1.0e12
    most: float = 1.0e12
    of: Literal["balloon", "world"] = "balloon"
    meaning: str = ""
    path: str = ""
    """where it stands in a scene, or in a balloon of it; in the table `law.NAME` of its law, when empty"""
    size: int = 1
    """3 for a vector"""


@dataclass(frozen=True, eq=False)
class Law:
    """A law of the simulation.

    Args of the bounds, by name: what the law's function is told of the state at rest, and its parameters; arrays of
    numpy, shape (W,) or as they come.
    """

    kind: Kind
    force: Any
    """a `wp.func`; see `GIVEN` for its arguments and `RESULT` for what it returns"""
    parameters: tuple[Parameter, ...] = ()
    name: str = ""
    """the function's own, when empty"""
    energy: Any = None
    """a `wp.func` of what the force names [J], whose negative gradient the force is; None if there is none"""
    neutral: Mapping[str, float] = field(default_factory=dict)
    """the law does nothing while all these parameters have these values: then it is left out"""
    wants: Callable[[Any], bool] | None = None
    """of a scene, whether the law belongs to it; to all, when missing"""
    stiffness: Callable[..., Any] | None = None
    """largest derivative of the force by the place [N/m], of a particle or for each end of a pair; 0 when missing"""
    drag: Callable[..., Any] | None = None
    """largest derivative of the force by the velocity, over the balloon's mass share [N s/m]; 0 when missing"""

    def __post_init__(self) -> None:
        if not self.name:
            object.__setattr__(self, "name", self.force.key.rpartition(".")[2])
