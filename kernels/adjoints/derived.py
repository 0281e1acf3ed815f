"""Adjoints that Warp derives of a phase's own function."""

from collections.abc import Sequence
from typing import Any

import warp as wp

from balloon_warp.kernels.compose import function_from
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.lanes import Lanes
from balloon_warp.kernels.phase import Adjoint, Adjoints, Look, NoAdjointError, Phase
from balloon_warp.kernels.tables import Tables

NOT_DIFFERENTIATED = frozenset(
    {
        *("t", "constants", "state", "working", "springs", "spheres", "world", "balloon", "particle", "face"),
        *("time", "end", "time_in_frame", "points", "velocities"),
    }
)
"""Names without a bar of their own: handles, items, times and views"""


@wp.struct
class Constants:
    """Numbers of the tables that most phases read; whole tables would be copied for a derivative."""

    up: wp.vec3
    step_seconds: float


@wp.func
def constants_of(t: Tables):
    """Return the constants of a step."""
    constants = Constants()
    constants.up = t.up
    constants.step_seconds = t.step_seconds
    return constants


@wp.func
def worth_of_eight(values: Lanes, bars: Lanes):
    """Return the sum over all lanes of numbers times their bars: by each lane's number, its own bar."""
    return wp.dot(values, bars)


@wp.func
def worth_of_eight(values: Any, bars: Any):  # noqa: F811 - an overload
    """Return the sum over all lanes of several numbers times their bars."""
    return wp.ddot(values, bars)


def nothing(phase: Phase, features: Features, look: Look) -> Sequence[Adjoint]:
    """Return no adjoint, for a phase that nothing else depends on, or whose value ends a derivative."""
    return ()


def by_grad(phase: Phase, features: Features, look: Look) -> Sequence[Adjoint]:
    """Return the adjoint that Warp derives of a phase's function."""
    return by_grad_but()(phase, features, look)


def by_grad_but(*frozen: str) -> Adjoints:
    """Return the factory of a phase's adjoint by Warp, with some of its arguments taken as constant."""

    def factory(phase: Phase, features: Features, look: Look) -> Sequence[Adjoint]:
        if look.world and not phase.takes_eight(features, look):
            raise NoAdjointError(f"{phase.name}, which takes no eight at a time,")
        function = phase.function(features, look)
        reads = ["constants" if name == "t" else name for name in phase.reads(features, look)]
        bars = [f"{name}_bar" for name in phase.writes]
        results = [f"{name}_result" for name in phase.writes]
        products = [
            _product(value, bar, dtype, bool(look.world))
            for value, bar, dtype in zip(results, bars, phase.writes.values(), strict=True)
        ]
        arguments = [*reads, *bars]
        of = tuple(name for name in reads if name not in NOT_DIFFERENTIATED and name not in frozen)
        typed = ", ".join(f"{name}: Any" for name in arguments)
        work = "\n".join(
            [
                f"def {phase.name}_work({typed}):",
                f"    {', '.join(results)} = {phase.name}({', '.join(reads)})",
                f"    return {' + '.join(products)}\n",
            ]
        )
        names = {phase.name: function, "worth_of_eight": worth_of_eight}
        names[f"{phase.name}_work"] = function_from(f"{phase.name}_work", work, names)
        adjoint = "\n".join(
            [
                f"def {phase.name}_adjoint({typed}):",
                f"    {', '.join(f'by_{name}' for name in arguments)} = wp.grad({phase.name}_work)"
                f"({', '.join(arguments)})",
                f"    return {', '.join(f'by_{name}' for name in of)}\n",
            ]
        )
        return (Adjoint(function_from(f"{phase.name}_adjoint", adjoint, names), of),)

    return factory


def _product(value: str, bar: str, dtype: Any, of_eight: bool) -> str:
    """Return the text of a value times its bar, added up over components and lanes."""
    if of_eight:
        return f"worth_of_eight({value}, {bar})"
    return f"{value} * {bar}" if dtype is float else f"wp.dot({value}, {bar})"
