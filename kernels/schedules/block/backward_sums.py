"""Sums over a frame that runs backwards: in each thread, and then over all threads of a block."""

from collections.abc import Sequence

from balloon_warp.kernels.schedules.block.backward_items import OVER_FRAME
from balloon_warp.kernels.schedules.block.rows import RowsWriter

FIVE = 5
"""Numbers that threads add up together"""


class SumsOfFrame(RowsWriter):
    """Write sums of bars over a frame."""

    columns: tuple[int, ...] = ()
    """Columns of the numbers that are derived by"""

    def _begin_sums(self) -> None:
        """Write the start values of sums, in each thread."""
        self.line("# Substeps run backwards.")
        for place in range(len(self.columns)):
            self.line(f"number_{place} = float(0.0)")
        for name, size in OVER_FRAME.items():
            self.line(f"over_{name} = {'wp.vec2()' if size == 2 else 'float(0.0)'}")
        self.line("load_part = is_first * all_load_bar[world, 0]")
        self.line("load_before = wp.vec2()")
        self.line("load_after = wp.vec2()")
        self.line("found_pressure_bar = float(0.0)")
        for value in self._kept_of("balloon"):
            self.line(f"found_{value}_bar = {value}_type()")

    def _end_sums(self) -> None:
        """Write the sums over all threads, and where they go."""
        of_frame = {
            "load_part": ("all_load_bar[world, 0]", 2), "over_keyed": ("all_keyed_bar_of_balloons[world, 0]", 2),
            "over_gas": ("all_gas_bar[world, 0]", 2), "over_gas_mass": ("all_gas_mass_bar[world, 0]", 1),
        }  # fmt: skip
        parts = [f"{name}[{n}]" if size > 1 else name for name, (_, size) in of_frame.items() for n in range(size)]
        parts += [f"number_{place}" for place in range(len(self.columns))]
        found = self._summed(parts)
        self.line("if thread == 0:")
        with self.indented():
            self.line("all_pressure_bar[world, 0] = 0.0")
            for place, size in of_frame.values():
                its, found = found[:size], found[size:]
                self.line(f"{place} = {its[0] if size == 1 else f'wp.vec2({its[0]}, {its[1]})'}")
            for place, total in enumerate(found):
                self.line(f"number_bars_of_balloons[world, 0, {place}] = {total}")

    def _summed(self, parts: Sequence[str]) -> list[str]:
        """Write sums over all threads, and return their names."""
        names = []
        for begin in range(0, len(parts), FIVE):
            some = parts[begin : begin + FIVE]
            self.line(f"put_bars(thread, Five({', '.join([*some, *['0.0'] * (FIVE - len(some))])}))")
            self.line("block_barrier()")
            self.line(f"sums_{begin} = total_bars(0)")
            self.line("block_barrier()")
            names += [f"sums_{begin}[{place}]" for place in range(len(some))]
        return names
