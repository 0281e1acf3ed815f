"""Loops over the items of a balloon, eight side by side, and their results and sums."""

from collections.abc import Callable, Mapping
from typing import Any

from balloon_warp.kernels.phase import STATE, Item
from balloon_warp.kernels.schedules.lanes.names import NamesInLanes
from balloon_warp.kernels.schedules.pieces import Piece

OFFSETS: Mapping[Item, str] = {
    "particle": "t.item_offsets",
    "face": "t.faces.balloon_offsets",
    "quad": "t.quad_offsets",
}
"""Begin of each balloon's items"""


class ItemsInLanes(NamesInLanes):
    """Write loops over items."""

    @staticmethod
    def _flips(piece: Piece, view: str) -> int:
        return sum(STATE[name] == view for name in piece.doubles)

    def _items(
        self, kind: Item, body: Callable[[], Any], before: str = "", after: Callable[[], Any] | None = None
    ) -> None:
        """Write a loop over the items of all balloons."""
        known = set(self.known)
        self.item = "item" if kind == "particle" else kind
        self.line("for balloon in range(tables.inflation_kind.shape[0]):")
        with self.deeper():
            lines, self.lines, self.of_balloon = self.lines, [], []
            self.known |= {"balloon", self.item}
            with self.deeper():
                body()
            of_items, self.lines = self.lines, lines
            self.lines += self.of_balloon
            if before:
                self.line(before)
            self.line(f"for {self.item} in range({OFFSETS[kind]}[balloon], {OFFSETS[kind]}[balloon + 1]):")
            self.lines += of_items
            self.known = known | {"balloon"}
            if after:
                after()
        self.known = known

    def _leave(self, piece: Piece) -> None:
        """Write the results of an item to where they are kept."""
        for name in piece.moves:
            view = STATE[name]
            target = self.place_of(view, self.flips[view] + self._flips(piece, view))
            self.line(f"put_item({target}, {self.item}, {name})")
        for name in piece.keeps:
            self.line(f"put_{name}(t, kept_{name}, group, {self.item}, {name})")
        for name in piece.leaves:
            if self.step.owner(name) == "balloon":
                continue
            if name in self.seen:
                self.line(f"put_item(all_{name}[{self.row}], {self.item}, {name})")
            else:
                self.line(f"all_{name}[{self.row}, {self.item}] = {name}")

    def _sum(self, piece: Piece) -> None:
        """Write the results of a balloon's items, and their sum."""
        *others, phase = piece.phases
        (value,) = phase.writes
        parts = f"{value}_parts"

        def add() -> None:
            self.calls(others)
            self.calls((phase,))
            pads = piece.item == "particle" and not self.layout.worlds
            if self.layout.as_octets:
                self.line(f"part = ({self.item} - {OFFSETS[piece.item]}[balloon]) % LANE_COUNT")
                self.line(f"{parts}[part] = {parts}[part] + {value}")
            else:
                self.line(f"{value}_total += {f'scaled({value}, t.present[item])' if pads else value}")
            self._leave(piece)

        def end() -> None:
            if self.layout.as_octets:
                self.line("for part in range(LANE_COUNT):")
                self.line(f"    {value}_total += {parts}[part]")
                self.line(f"    {parts}[part] = {value}_lanes()")
            self.line(f"all_{value}[{self.row}, balloon] = totals_of({value}_total)")

        if self.layout.as_octets:
            self.line(f"{parts} = all_{parts}[{self.place}]")
        self._items(piece.item, add, f"{value}_total = {value}_lanes()", end)
