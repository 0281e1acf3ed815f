"""Turns of the balloon backwards for all substeps of a frame side by side, a thread each.

An adjoint is linear in bars. So what it makes of a unit of each is found ahead, a substep by each thread; once the sum
over particles is there, all threads need only multiply. What adds up over the frame is found after its substeps, from
the sums that they have noted.
"""

import re
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import warp as wp

UNITS = (("wp.vec2(1.0, 0.0)", "0.0"), ("wp.vec2(0.0, 1.0)", "0.0"), ("wp.vec2()", "1.0"))
"""Units of the bars of what the gas presses with, and of its pressure at the end of a frame"""
SUMS = 2
"""Numbers of a sum over particles"""


class OfBalloon(NamedTuple):
    """Hold the turns of a balloon between two sums."""

    lines: Sequence[str]
    """Statements that find bars, from `load_bar` and `found_pressure_bar`"""
    results: dict[str, str]
    """Bars that particles read, by the names of the balloon's values"""
    sums: Sequence[str]
    """Statements that add up over a frame"""

    @property
    def is_linear(self) -> bool:
        """Return whether nothing else is asked for: no other bars, nor what was pressed with."""
        others = {"load_before", "load_after", *re.findall(r"found_\w+_bar", "\n".join(self.lines))}
        words = set(re.findall(r"\w+", "\n".join([*self.lines, *self.sums])))
        return words.isdisjoint(others - {"found_pressure_bar"})


def size_of(dtype: Any) -> int:
    """Return how many numbers a value has."""
    return 1 if dtype is float else dtype._length_


def part_of(text: str, dtype: Any, number: int) -> str:
    """Return the text of one of its numbers."""
    return text if dtype is float else f"{text}[{number}]"


class Ahead:
    """Write the turns of a balloon ahead, and after.

    Args:
        of_balloon: its turns.
        types: of the balloon's values.
        threads: of the block.
        write: writes a line.
        begin: writes what each substep has noted of the balloon, and its time.
        anew: statements that read what stays the same in a frame.
    """

    def __init__(
        self, of_balloon: OfBalloon, types: dict[str, Any], threads: int, write: Callable[[str], None],
        begin: Callable[[Callable[[str], None]], None], anew: Sequence[str],
    ):  # fmt: skip
        self.of_balloon, self._types, self._threads, self._line, self._begin = of_balloon, types, threads, write, begin
        self._anew = anew

    @property
    def _parts(self) -> list[tuple[str, int]]:
        """Return the numbers of the bars that particles read."""
        return [(name, part) for name in self.of_balloon.results for part in range(size_of(self._types[name]))]

    def _over_substeps(self) -> None:
        self._line(f"for ahead in range(thread, t.substeps, {self._threads}):")
        self._line("    row = first_row + ahead")
        self._line("    time_in_frame = float(ahead) * t.step_seconds")
        self._begin(lambda text: self._line(f"    {text}"))

    def before(self) -> None:
        """Write what each unit becomes."""
        self._line("# What a unit of what particles find of the balloon becomes, in each substep.")
        self._over_substeps()
        width = len(self._parts)
        for number, (load, pressure) in enumerate(UNITS):
            self._line(f"    load_bar = {load}")
            self._line(f"    found_pressure_bar = {pressure}")
            self._lines(self.of_balloon.lines)
            for place, (name, part) in enumerate(self._parts):
                text = part_of(self.of_balloon.results[name], self._types[name], part)
                self._line(f"    all_slopes[row, {number * width + place}] = {text}")
        self._line("block_barrier()")

    def read(self) -> None:
        """Write how a substep reads the slopes, but for those by the pressure at the end of a frame."""
        for place in range(len(self._parts) * SUMS):
            self._line(f"slope_{place} = float_in(all_slopes, row, {place})")

    def turn(self) -> None:
        """Write what follows once there is the sum."""
        width = len(self._parts)
        self._line("if thread == 0:")
        self._line("    all_load_sums[row, 0] = load_bar")
        by_load = [f"slope_{at} * load_bar[0] + slope_{width + at} * load_bar[1]" for at in range(width)]
        by_pressure = [f"float_in(all_slopes, row, {SUMS * width + at}) * found_pressure_bar" for at in range(width)]
        for sign, indent, parts in (("=", "", by_load), ("+=", "    ", by_pressure)):
            if indent:
                self._line("if back == 0:")
            for name in self.of_balloon.results:
                its = [part for part, (owner, _) in zip(parts, self._parts, strict=True) if owner == name]
                whole = its[0] if self._types[name] is float else f"{name}_type({', '.join(its)})"
                self._line(f"{indent}found_{name}_bar {sign} {whole}")

    def after(self) -> None:
        """Write what adds up over the frame, once what the balloon has is read again: it takes no registers before."""
        self._line("block_barrier()")
        for line in self._anew:
            self._line(line)
        self._over_substeps()
        self._line("    load_bar = all_load_sums[row, 0]")
        self._line("    found_pressure_bar = wp.where(ahead + 1 == t.substeps, all_pressure_bar[world, 0], 0.0)")
        self._lines([*self.of_balloon.lines, *self.of_balloon.sums])

    def _lines(self, lines: Sequence[str]) -> None:
        for line in lines:
            self._line(f"    {line.strip()}")

    @property
    def width(self) -> int:
        """Return how many slopes a row has."""
        return len(UNITS) * len(self._parts)


ARGUMENTS = {"all_slopes": "wp.array2d[float]", "all_load_sums": "wp.array2d[wp.vec2]"}
"""Arrays with a row for each substep"""
TYPES = {"all_slopes": wp.float32, "all_load_sums": wp.vec2}
"""Types of their numbers"""
