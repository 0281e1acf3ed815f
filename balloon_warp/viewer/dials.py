"""A number and its slider, which goes by factors around the number that a scene says."""

import math
from collections.abc import Callable
from typing import Any

import viser
from viser._messages import GuiSliderMark

from balloon_warp.viewer.sliders import WIDER, Value

FACTOR = 10.0
"""Range of a slider over the scene's value, upward and downward"""
END = 1.0
"""End of a slider to the right, and to the left with the other sign: the scene's value is at 0"""
DIGITS = "{:.4g}"


class Dial:
    """Adds a box for a number to the panel, and a slider below it.

    Args:
        gui: of the page.
        value: that it sets.
        act: called with a number that somebody sets, within the dial's range.
        tell: called with a sentence where a typed number is beyond that.
    """

    def __init__(
        self, gui: viser.GuiApi, value: Value, act: Callable[[float], None], tell: Callable[[str], None]
    ) -> None:
        self.value, self._act, self._tell = value, act, tell
        self._base, self._least, self._most, self._by_factors = 1.0, 0.0, 1.0, True
        self.box = gui.add_number(value.label, 1.0, step=1e-6, hint=value.row.meaning or None)
        self.slider = gui.add_slider("", -END, END, END / 100.0, 0.0, marks=(-END, END))
        on_change(self.box, self._type)
        on_change(self.slider, self._slide)

    @property
    def visible(self) -> bool:
        """Return whether the dial is visible."""
        return self.box.visible

    @visible.setter
    def visible(self, visible: bool) -> None:
        if visible != self.box.visible:
            self.box.visible = self.slider.visible = visible

    def reach(self, number: float) -> None:
        """Set the range around a scene's value.

        By factors of it down to a tenth, and then 0; or evenly from 0, where it is 0 or may have either sign.
        """
        row = self.value.row
        self._base, self._by_factors = number, number > 0.0 and not self.value.signed
        if self._by_factors:
            self._most = min(FACTOR * number, row.most)
            self._least = 0.0 if row.least <= 0.0 else max(number / FACTOR, row.least)
        else:
            self._most = min(max(WIDER * abs(number), self.value.least_reach), row.most)
            self._least = max(-self._most, row.least) if self.value.signed else 0.0
        ends = ((-END, self._least), (END, self._most))
        self.slider._marks = tuple(GuiSliderMark(value=place, label=DIGITS.format(end)) for place, end in ends)

    def put(self, number: float) -> None:
        """Show a number."""
        self.box.value = float(DIGITS.format(number))
        self.slider.value = self._place(number)

    def _type(self, number: float) -> None:
        within = clamped(self.value.label, number, self._least, self._most, self._tell)
        if within != number:
            self.box.value = within
        self.slider.value = self._place(within)
        self._act(within)

    def _slide(self, place: float) -> None:
        number = float(DIGITS.format(self._number(place)))
        self.box.value = number
        self._act(number)

    def _number(self, place: float) -> float:
        if place >= END:
            return self._most
        if place <= -END:
            return self._least
        if not self._by_factors:
            return self._least + (self._most - self._least) * (place + END) / (2.0 * END)
        return min(max(self._base * FACTOR ** (place / END), self._least), self._most)

    def _place(self, number: float) -> float:
        if not self._by_factors:
            return END * (2.0 * (number - self._least) / (self._most - self._least) - 1.0)
        return END * min(max(math.log(max(number, 1e-30) / self._base, FACTOR), -1.0), 1.0)


def on_change(handle: Any, act: Callable[[Any], None]) -> None:
    """Act on values set in a page, not on values that the server sets.

    It acts at once, on the thread that received the value: later the server might have set another.
    """

    @handle.on_update
    async def _(event: Any) -> None:
        if event.client is not None:
            act(handle.value)


def on_slide(slider: Any, act: Callable[[float], None], tell: Callable[[str], None]) -> None:
    """Act on slider values as `on_change`, with typed values kept within the slider's ends."""

    def heard(number: float) -> None:
        within = clamped(slider.label, number, slider.min, slider.max, tell)
        if within != number:
            slider.value = within
        act(within)

    on_change(slider, heard)


def clamped(label: str, number: float, least: float, most: float, tell: Callable[[str], None]) -> float:
    """Return a number, or the end of its range that it is beyond, which is then reported."""
    within = min(max(number, least), most)
    if within != number:
        end = "maximum" if number > most else "minimum"
        tell(f"{label}: {DIGITS.format(within)} is the {end} here (got {DIGITS.format(number)})")
    return within
