"""Layout of the parameters of laws in memory: a row of numbers for each balloon, and one for each world."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from balloon_warp.kernels.laws.added_mass import ADDED_MASS
from balloon_warp.kernels.laws.body import MASS
from balloon_warp.kernels.laws.contact import FRICTION, GROUND
from balloon_warp.kernels.laws.fill import PARAMETERS as FILL
from balloon_warp.kernels.laws.gas import PARAMETERS as GAS
from balloon_warp.kernels.laws.hooke import KINDS
from balloon_warp.kernels.laws.law import Law, Parameter
from balloon_warp.kernels.laws.membrane import PARAMETERS as MEMBRANE
from balloon_warp.kernels.laws.orifice import PARAMETERS as OPENINGS
from balloon_warp.kernels.laws.touch import TOUCH


@dataclass(frozen=True)
class Columns:
    """The parameters in order. Kernels have a balloon's numbers and then its world's in one row."""

    balloon: tuple[Parameter, ...]
    world: tuple[Parameter, ...]

    @cached_property
    def places(self) -> dict[str, int]:
        """The column of each parameter in that row, of a vector the first of three."""
        places, column = {}, 0
        for parameter in self.rows:
            places[parameter.name] = column
            column += parameter.size
        return places

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


def columns_of(laws: Sequence[Law]) -> Columns:
    """List the parameters of these laws and of all that every scene has, each once.

    The others are those of springs, membranes, inertia, gas and its openings, the ground and touching balloons. The
    kinds of springs stand first.
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
        *(parameter for law in laws for parameter in law.parameters),
    )
    by_name = {parameter.name: parameter for parameter in reversed(asked)}
    ordered = [by_name[name] for name in dict.fromkeys(parameter.name for parameter in asked)]
    return Columns(
        tuple(parameter for parameter in ordered if parameter.of == "balloon"),
        tuple(parameter for parameter in ordered if parameter.of == "world"),
    )
