"""Sums of the laws' bounds around each particle of a balloon."""

import inspect
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from balloon_warp.kernels.laws import Law, columns_of
from balloon_warp.kernels.laws.law import Kind
from balloon_warp.kernels.laws.springs import KINDS
from balloon_warp.model.materials import law_of, numbers_of, stiffest_modulus, thickest_viscosity
from balloon_warp.model.parameters import Parameters
from balloon_warp.model.shape import Surroundings
from balloon_warp.scene import Scene

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
                yield told_what_it_names(getattr(law, bound))


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


def told_what_it_names(bound: Callable[..., Any]) -> Callable[..., Any]:
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
