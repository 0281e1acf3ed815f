"""Turns of a block backwards that are not of its particles: those of its balloon, and of faces of membranes."""

import inspect
from collections.abc import Sequence
from typing import Any

from balloon_warp.kernels.adjoints.eights import EIGHT, sum_of_lanes
from balloon_warp.kernels.adjoints.springs import KINDS
from balloon_warp.kernels.schedules.block.backward_items import SUM_OF_LOADS, TurnsInBlock
from balloon_warp.kernels.schedules.block.backward_sums import SumsOfFrame
from balloon_warp.kernels.schedules.block.items import COUNTS
from balloon_warp.kernels.schedules.block.layout import Layout
from balloon_warp.kernels.schedules.pieces import Step

Turns = Sequence[tuple[TurnsInBlock, tuple[str, ...]]]
"""Writers of the turns between two waits, and their lines"""


class TurnsBesideParticles(SumsOfFrame):
    """Write turns of the balloon and of faces."""

    def __init__(self, kept: Step, layout: Layout):
        super().__init__(kept, layout)
        self.called: dict[str, Any] = {}
        """Functions that turns call, by their names"""
        self.of_kinds = False
        """Whether eight particles at a time add up bars of the constants of springs"""

    def _turn_faces(self, writer: TurnsInBlock, numbers: str) -> None:
        """Write how faces of membranes run backwards, before their particles gather the bars that they leave."""
        for entry, adjoint in writer.turns:
            if adjoint.of_face is None:
                continue
            function = f"{entry.phase.name}_of_face"
            self.called[function] = adjoint.of_face
            told = inspect.signature(adjoint.of_face.func).parameters
            call = f"{function}({', '.join(numbers if name == 'n' else name for name in told)})"
            count = COUNTS["membrane_face"]
            self.line(f"for membrane_face in range(thread, {count}, {self.layout.threads}):")
            self.line(f"    by_numbers = {call}" if self.columns else f"    {call}")
            for place, column in enumerate(self.columns):
                self.line(f"    number_{place} += by_numbers[{column}]")
            self.line("block_barrier()")

    def _turn_eights(self, writer: TurnsInBlock) -> None:
        """Write the turns that a CPU does for eight particles at a time."""
        begin, apart = writer.bars_of_particles.words_of("point") if writer.of_eights else (0, 0)
        given = {"n": "first.n", "found": "bars_of_particles", "row": "world", "kinds": "kinds_bars"}
        given |= {"first_word": str(begin), "apart": str(apart)}
        for number, (entry, adjoint) in enumerate(writer.of_eights):
            function = f"{entry.phase.name}_of_eight_{number + 1}"
            self.called[function] = adjoint.of_eight
            told = inspect.signature(adjoint.of_eight.func).parameters
            self.line(f"# Backwards, eight at a time: {entry.phase.summary}")
            self.line(f"{function}({', '.join(given.get(name, name) for name in told)})")

    def _begin_kinds(self, turns: Turns) -> None:
        """Write where eight particles at a time add up bars of the constants of springs, if they do."""
        self.of_kinds = any(set(KINDS) <= {*adjoint.of} for writer, _ in turns for _, adjoint in writer.of_eights)
        if self.of_kinds:
            self.line(f'kinds_bars = wp.tile_zeros(shape={EIGHT * len(KINDS)}, dtype=float, storage="shared")')

    def _end_kinds(self) -> None:
        """Write the sums of those bars, once a frame has run backwards."""
        for number, name in enumerate(KINDS if self.of_kinds else ()):
            column = self.features.columns.places[name]
            if column in self.columns:
                self.called["sum_of_lanes"] = sum_of_lanes
                self.line(f"number_{self.columns.index(column)} += sum_of_lanes(kinds_bars, {number})")

    def _turn_balloon(self, writer: TurnsInBlock, lines: Sequence[str]) -> None:
        """Write the bars of the balloon's values that follow from those that its particles have found."""
        for line in SUM_OF_LOADS:
            self.line(line)
        self.lines += lines
        for name, text in writer.results.items():
            self.line(f"found_{name}_bar = {text}")
        for text in writer.sums:
            target, added = text.split(" += ")
            self.line(f"{target} += is_first * ({added})")

    def _find_loads(self) -> None:
        """Write the loads by the gas in this substep, and in the one before."""
        self.line("load_now = all_gas_load[row, 0]")
        self.line("load_after = wp.vec2(load_now[1], load_now[2])")
        self.line("load_before = two_in(state.inflation_loads, world, 0)")
        self.line("if back + 1 < t.substeps:")
        self.line("    load_then = all_gas_load[row - 1, 0]")
        self.line("    load_before = wp.vec2(load_then[1], load_then[2])")
        self.line("found_pressure_bar = wp.where(back == 0, all_pressure_bar[world, 0], 0.0)")
