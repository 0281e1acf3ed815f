"""Values that differ between worlds, from the command line's words: ranges and lists."""

import math
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.scene.load import find_mesh


@dataclass(frozen=True)
class Range:
    """Numbers from `low` to `high`."""

    low: float
    high: float


Choice = Range | list[float] | list[str]
"""Range, which is sampled; or list, which is cycled"""


def parse_vary(text: str, scene_source: str = "") -> tuple[str, Choice]:
    """Split `PATH=LOW:HIGH` or `PATH=VALUE,VALUE,...`; only meshes are given by words.

    Args:
        text: the argument of `--vary`.
        scene_source: the scene that the command names; meshes are sought beside its file, too.

    Raises:
        InputError: the text has neither form.
    """
    path, _, words = (part.strip() for part in text.partition("="))
    values = [word.strip() for word in words.split(",")]
    if all(path.split(".")) and all(values):
        if path.split(".")[-1] == "mesh":
            return path, [str(find_mesh(value, scene_source)) for value in values]
        ends = words.split(":")
        numbers = [_number(word) for word in (ends if len(ends) == 2 else values)]
        if None not in numbers:
            if len(ends) != 2:
                return path, [number for number in numbers if number is not None]
            low, high = float(ends[0]), float(ends[1])
            if low < high:
                return path, Range(low, high)
    raise InputError(
        f"--vary {text}: expected PATH=LOW:HIGH with LOW below HIGH, or PATH=NUMBER,NUMBER,..., as in --vary "
        "balloon.inflation.k_normal=0:8 or --vary sphere.0.mass=1,10,100; `compare` also varies words"
    )


def ends_of(choices: Mapping[str, Choice]) -> dict[str, list[float] | list[str]]:
    """Find the ends of ranges, and the values of lists, by their paths."""
    return {
        path: [choice.low, choice.high] if isinstance(choice, Range) else choice for path, choice in choices.items()
    }


def spread(choices: dict[str, Choice], world_count: int, seed: int = 0, grid: bool = False) -> dict[str, NDArray]:
    """Draw a value for each world, as arrays of shape (world_count,).

    Lists are cycled: world w takes value w modulo the list's length. Ranges are sampled uniformly, each from a stream
    of its own, so that a world's value depends on the seed, the path and its number alone; or, with `grid`, are divided
    evenly, ends included: world w takes point w modulo the number of points of the product of all ranges, the first
    range varying fastest, with about as many points on each range and no more points than worlds.
    """
    worlds = np.arange(world_count)
    ranges = {path: choice for path, choice in choices.items() if isinstance(choice, Range)}
    sides = _grid_sides(len(ranges), world_count) if grid else []
    places = np.unravel_index(worlds % math.prod(sides), sides, order="F") if sides else ()
    in_grid = dict(zip(ranges, zip(sides, places, strict=True), strict=True)) if grid else {}
    values: dict[str, NDArray] = {}
    for path, choice in choices.items():
        if not isinstance(choice, Range):
            values[path] = np.array(choice)[worlds % len(choice)]
        elif grid:
            side, place = in_grid[path]
            values[path] = np.linspace(choice.low, choice.high, side)[place]
        else:
            stream = np.random.default_rng([seed, zlib.crc32(path.encode())])
            values[path] = stream.uniform(choice.low, choice.high, len(worlds))
    return values


def parse_export(text: str, world_count: int) -> list[int]:
    """Read the worlds of `all`, `none` or `0,5,9`.

    Raises:
        InputError: it is none of these, or there is no such world.
    """
    if text in ("all", "none"):
        return list(range(world_count)) if text == "all" else []
    try:
        worlds = sorted({int(word) for word in text.split(",")})
    except ValueError:
        raise InputError(f"export {text}: expected all, none, or worlds such as 0,5,9") from None
    for world in worlds:
        if not 0 <= world < world_count:
            raise InputError(f"export {text}: no world {world}, the batch has worlds 0 to {world_count - 1}")
    return worlds


def _grid_sides(range_count: int, world_count: int) -> Sequence[int]:
    """Return the number of points on each range, whose product is at most `world_count`; the first ones get more."""
    if not range_count:
        return []
    sides = [max(int(world_count ** (1.0 / range_count)) - 1, 1)] * range_count  # a root may be rounded up
    grew = True
    while grew:
        grew = False
        for axis in sorted(range(range_count), key=lambda axis: sides[axis]):
            if math.prod(sides) // sides[axis] * (sides[axis] + 1) <= world_count:
                sides[axis] += 1
                grew = True
                break
    return sides


def _number(word: str) -> float | None:
    try:
        number = float(word)
    except ValueError:
        return None
    return number if math.isfinite(number) else None
