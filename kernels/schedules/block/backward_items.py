"""Phases backwards within a block: threads loop over particles, or all find the same of the one balloon.

Bars that others read are in shared memory. Sums over a frame are in each thread's registers.
"""

from collections.abc import Collection
from typing import Any, ClassVar

from balloon_warp.kernels.adjoint import Adjoint
from balloon_warp.kernels.phase import STATE
from balloon_warp.kernels.schedules.block.layout import Layout
from balloon_warp.kernels.schedules.block.notes import Notes
from balloon_warp.kernels.schedules.launched.backward_writer import BackwardWriter
from balloon_warp.kernels.schedules.launched.trace import Entry

KNOWN = ("thread", "first", "balloon", "points", "pulls", "area_vectors")
"""Names that the block has found before, besides handles"""
OVER_FRAME: dict[str, int] = {"keyed": 2, "gas": 2, "gas_mass": 1}
"""Bars that add up over a frame, and how many numbers they have"""

SUM_OF_LOADS = (
    "put_load_bar(thread, Five(load_part[0], load_part[1], 0.0, 0.0, 0.0))",
    "block_barrier()",
    "load_sum = total_load_bar(0)",
    "load_part = wp.vec2()",
    "load_bar = wp.vec2(load_sum[0], load_sum[1])",
)
"""Statements that add up the bars of the load that particles have found"""


class TurnsInBlock(BackwardWriter):
    """Write turns between two barriers.

    Args:
        tiles: names of the bars that stand in shared memory.
        notes: places of the particles' notes.
        bars: places of bars that no other particle sees.
    """

    row: ClassVar[str] = "row"

    def __init__(self, layout: Layout, tiles: Collection[str], notes: Notes, bars: Notes, *of_turns: Any):
        super().__init__(*of_turns)
        self.layout, self.tiles, self.notes, self.bars_of_particles = layout, tiles, notes, bars
        self.results: dict[str, str] = {}
        """Bars of the balloon's values that its turns find"""
        self.sums: list[str] = []
        """Statements of its turns that add up over a frame"""
        self.aliases = {} if any(layout.slots) else {"springs": "working"}
        self.known |= {*KNOWN, *(f"{name}_bars" for name in tiles)}
        self.indent = "        "
        alone = layout.threads == 1 and not layout.held
        self.of_eights = [turn for turn in self.turns if turn[1].of_eight] if alone and "point" in bars else []
        """Turns that one thread does for eight particles at a time"""

    @property
    def of_balloon(self) -> bool:
        """Return whether all threads find the same."""
        return self.trace.item == "balloon"

    def open(self) -> None:
        """Write a loop over particles, or nothing: the sum of the load's bars that they have found comes before."""
        if self.of_balloon:
            self.known.add("load_bar")
            return
        self.line(f"for particle in range(thread, count, {self.layout.threads}):")
        self.indent += "    "
        self.known.add("particle")

    def found(self, name: str) -> tuple[str, str] | None:
        """Return the arguments that a name depends on, and the text that computes it."""
        if name == "springs":
            varying = "read_springs(t, slots, params, particle, True)"
            return "params", varying if self.step.features.springs_vary else "read_pairs(slot_pairs, slots, params)"
        texts = {
            "load": "load_after" if self.after_note else "load_before",
            "params": "read_params_beside(t, first, particle)",
            "numbers": "first.n",
            "velocities": "all_velocities[row]",
            "origin": self.notes.read("point", "row", "volume_origin(t, balloon)"),
        }
        if name in texts:
            return "", texts[name]
        if name == "point":
            return "", "in_tile(points, particle)"
        if name in STATE:
            return "", self.noted(name, "particle")
        if name in self.step.kept:
            return "", self.noted(name, self.step.owner(name))
        return super().found(name)

    def noted(self, name: str, owner: str) -> str:
        """Return the text that finds a note of the substep."""
        return self.notes.read(name, "row") if owner == "particle" else f"all_{name}[row, {owner}]"

    def _turn(self, entry: Entry, adjoint: Adjoint) -> None:
        if (entry, adjoint) not in self.of_eights:
            super()._turn(entry, adjoint)

    # ---- where bars stand

    def bar_at(self, name: str, owner: str) -> str:
        """Return the text that finds a bar that others have found."""
        if owner == "balloon":
            return f"found_{name}_bar"
        if name in self.tiles:
            return f"in_tile({name}_bars, particle)"
        if name in self.bars_of_particles:
            return self.bars_of_particles.read(name, "world")
        return super().bar_at(name, owner)

    def put_bar(self, name: str, owner: str, sign: str, text: str) -> None:
        """Write a bar to where others find it, or add to it."""
        if name == "load":
            self.line(f"load_part += {text}")
        elif owner == "balloon":
            self.results[name] = f"{self.results[name]} + {text}" if sign == "+=" else text
        elif name in self.tiles or name in self.bars_of_particles:
            before = f"{self.bar_at(name, owner)} + " if sign == "+=" else ""
            if name in self.tiles:
                self.line(f"put_in_tile({name}_bars, particle, {before}{text})")
            else:
                self.line(self.bars_of_particles.write(name, "world", before + text))
        else:
            super().put_bar(name, owner, sign, text)

    def line(self, text: str) -> None:
        """Write a line, or keep it for once the frame has run backwards."""
        if self.of_balloon and text.startswith(("over_", "number_")):
            self.sums.append(text)
        else:
            super().line(text)

    def add_to_number(self, place: int, text: str) -> None:
        """Add to the bar of a number that is asked for."""
        self.line(f"number_{place} += {self.its_own(text, 'float(0.0)')}")

    def add_over_frame(self, name: str, text: str) -> None:
        """Add to the bar of a value that stays the same in a frame."""
        zero = "wp.vec2()" if OVER_FRAME[name] == 2 else "float(0.0)"
        self.line(f"over_{name} += {self.its_own(text, zero)}")

    def its_own(self, text: str, zero: str) -> str:
        """Return a thread's term of a sum; zero where it has no particle."""
        return text
