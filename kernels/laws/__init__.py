"""Laws of forces: on a particle, along a spring or a string, at a hinge, on a face, in a balloon, in a contact.

Each has its formula, units, source, energy, and its bounds of the step. The list is all that the rest of the house
knows of them: a law that stands there has its parameters in scenes, and acts in every schedule. In memory parameters
are a row of numbers for each balloon, one for each sphere, and one for each world.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import accumulate

from balloon_warp.kernels.laws.air import AIR_DRAG
from balloon_warp.kernels.laws.contact import FRICTION, GROUND, SPHERE
from balloon_warp.kernels.laws.flow import FILL_PARAMETERS, OPENING_PARAMETERS
from balloon_warp.kernels.laws.gas import ADDED_MASS
from balloon_warp.kernels.laws.gas import PARAMETERS as GAS
from balloon_warp.kernels.laws.law import Law, LawInput, Parameter
from balloon_warp.kernels.laws.membrane import PARAMETERS as MEMBRANE
from balloon_warp.kernels.laws.membrane import SOFTENING_PARAMETERS, TEARING_PARAMETERS
from balloon_warp.kernels.laws.outer import DAMPING, FACE_AIR, MASS, WATER, WEIGHT
from balloon_warp.kernels.laws.springs import HOOKE, KINDS, RUBBER, RUBBER_AT_LIMIT, STRING, TORSION
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
        *FILL_PARAMETERS,
        *OPENING_PARAMETERS,
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


LAWS: tuple[Law, ...] = (WEIGHT, DAMPING, HOOKE, RUBBER, RUBBER_AT_LIMIT, STRING, TORSION, WATER, AIR_DRAG, FACE_AIR)
"""Laws of the core, in the order in which their forces are added"""
PARAMETERS: dict[str, Parameter] = {row.name: row for row in columns_of(LAWS).rows}
"""Parameters that every scene has, by name: those of these laws, and of springs, inertia, gas and the ground"""
TAKEN: dict[str, Parameter] = PARAMETERS | {row.name: row for row in (*SOFTENING_PARAMETERS, *TEARING_PARAMETERS)}
"""Reserved names, which user-defined laws cannot give to other parameters: `PARAMETERS`, and those that only few scenes
have"""

__all__ = ["LAWS", "PARAMETERS", "TAKEN", "Law", "LawInput", "Parameter"]
