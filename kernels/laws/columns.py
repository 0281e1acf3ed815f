"""Layout of parameters in memory: a row of numbers for each balloon, one for each sphere, and one for each world."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import accumulate

from balloon_warp.kernels.laws.added_mass import ADDED_MASS
from balloon_warp.kernels.laws.body import MASS
from balloon_warp.kernels.laws.contact import FRICTION, GROUND, SPHERE
from balloon_warp.kernels.laws.fill import FILL
from balloon_warp.kernels.laws.gas import PARAMETERS as GAS
from balloon_warp.kernels.laws.law import Law, Parameter
from balloon_warp.kernels.laws.membrane import PARAMETERS as MEMBRANE
from balloon_warp.kernels.laws.orifice import OPENINGS
from balloon_warp.kernels.laws.springs import KINDS
from balloon_warp.kernels.laws.touch import TOUCH


@dataclass(frozen=True, eq=False)
class Columns:
    """The parameters in order. Kernels have a balloon's numbers and then its world's in one row.

    Those of the same parameters are one object, see `_interned`: kernels are looked up by them often.
    """

    balloon: tuple[Parameter, ...]
    world: tuple[Parameter, ...]
    sphere: tuple[Parameter, ...] = ()

    @cached_property
    def places(self) -> dict[str, int]:
        """The column of each parameter in that row, of a vector the first of three."""
        return _places(self.rows)

    @cached_property
    def places_of_spheres(self) -> dict[str, int]:
        """The column of each parameter in a sphere's row."""
        return _places(self.sphere)

    @cached_property
    def sizes(self) -> dict[str, int]:
        """Numbers of each parameter."""
        return {parameter.name: parameter.size for parameter in (*self.rows, *self.sphere)}

    @property
    def rows(self) -> tuple[Parameter, ...]:
        """Parameters of balloons, then those of the world."""
        return (*self.balloon, *self.world)

    @property
    def balloon_width(self) -> int:
        """Numbers of a balloon."""
        return sum(parameter.size for parameter in self.balloon)

    @property
    def world_width(self) -> int:
        """Numbers of a world."""
        return sum(parameter.size for parameter in self.world)

    @property
    def width(self) -> int:
        """Width of the whole row."""
        return self.balloon_width + self.world_width


def _places(rows: Sequence[Parameter]) -> dict[str, int]:
    ends = accumulate((row.size for row in rows), initial=0)
    return {row.name: begin for row, begin in zip(rows, ends, strict=False)}


def columns_of(laws: Sequence[Law], others: Sequence[Parameter] = ()) -> Columns:
    """List the parameters of these laws, other ones, and those of all that every scene has, each once.

    The latter are those of springs, membranes, inertia, gas and its openings, the ground, spheres and touching
    balloons. The kinds of springs stand first.
    """
    asked = (
        *KINDS,
        MASS,
        *GAS,
        ADDED_MASS,
        *FILL,
        *OPENINGS,
        FRICTION,
        *GROUND,
        *TOUCH,
        *MEMBRANE,
        *SPHERE,
        *(parameter for law in laws for parameter in law.parameters),
        *others,
    )
    by_name = {parameter.name: parameter for parameter in reversed(asked)}
    ordered = [by_name[name] for name in dict.fromkeys(parameter.name for parameter in asked)]
    return _interned(
        tuple(parameter for parameter in ordered if parameter.of == "balloon"),
        tuple(parameter for parameter in ordered if parameter.of == "world"),
        tuple(parameter for parameter in ordered if parameter.of == "sphere"),
    )


@cache
def _interned(*rows: tuple[Parameter, ...]) -> Columns:
    return Columns(*rows)
