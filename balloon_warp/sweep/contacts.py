"""Columns of a batch's summary that say how hard things press each other, of pairs that touched in any world."""

from collections.abc import Iterable, Iterator, Sequence
from itertools import chain, count
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from balloon_warp.contacts import things_of
from balloon_warp.model import ModelPlan

COLUMNS = {
    "force_mean": ("N", "net force of {pair}: mean magnitude over all frames"),
    "torque_mean": ("N m", "torque of {pair} about the mean of the latter's points: mean magnitude over all frames"),
    "area_mean": ("m^2", "contact area of {pair}: mean over all frames"),
    "pressure_mean": ("Pa", "largest pressure of {pair} on a particle: mean over all frames"),
    "force_max": ("N", "net force of {pair}: maximum over all frames"),
    "torque_max": ("N m", "torque of {pair} about the mean of the latter's points: maximum over all frames"),
    "area_max": ("m^2", "contact area of {pair}: maximum over all frames"),
    "pressure_max": ("Pa", "largest pressure of {pair} on a particle: maximum over all frames"),
}
"""Suffixes of a pair's columns, in the order in which a `Recorder` keeps them, with units and meanings"""


class Pair(NamedTuple):
    """A thing and a balloon that it pressed; of two balloons the first is the one that is pressed."""

    balloon: int
    thing: int
    label: str
    """Prefix of the pair's columns: "floor_on_ball" """
    sentence: str
    """Phrase for the pair: "floor on ball" """


def contacts_shape(plan: ModelPlan) -> tuple[int, int]:
    """Return how many balloons and things a world has, of which it is noted how they press; none unasked."""
    return len(plan.shapes), len(things_of(plan)) if plan.scene.contacts else 0


def pressing_pairs(plan: ModelPlan, contacts: NDArray[np.float32]) -> list[Pair]:
    """List the pairs that touched in any world, in the scene's order.

    Args:
        plan: of a world.
        contacts: of all worlds, shape (world_count, *contacts_shape(plan), len(COLUMNS)).
    """
    things = things_of(plan)
    first = len(things) - len(plan.shapes)
    names = _different(name.replace(" ", "_") for name in things)
    touched = (contacts > 0.0).any(axis=(0, 3))
    return [
        Pair(number, thing, f"{names[thing]}_on_{names[own]}", f"{things[thing]} on {things[own]}")
        for number, thing in np.argwhere(touched).tolist()
        for own in [first + number]
        if thing >= own or thing < first
    ]


def pair_columns(pairs: Sequence[Pair], contacts: NDArray[np.float32]) -> Iterator[tuple[str, NDArray[np.float32]]]:
    """Yield names and values of the columns of pairs, shape (world_count,)."""
    for pair in pairs:
        for column, name in enumerate(COLUMNS):
            yield f"{pair.label}_{name}", contacts[:, pair.balloon, pair.thing, column]


def describe_pairs(pairs: Sequence[Pair]) -> dict[str, tuple[str, str]]:
    """Describe unit and meaning of the columns of pairs, by name."""
    return {
        f"{pair.label}_{name}": (unit, meaning.format(pair=pair.sentence))
        for pair in pairs
        for name, (unit, meaning) in COLUMNS.items()
    }


def _different(names: Iterable[str]) -> list[str]:
    """Make all names different: those that are the same as one before get numbers."""
    chosen: list[str] = []
    for name in names:
        numbered = (f"{name}_{number}" for number in count(1))
        chosen.append(next(free for free in chain([name], numbered) if free not in chosen))
    return chosen
