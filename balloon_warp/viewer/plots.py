"""Curves of measures over the last seconds."""

from collections import deque

import numpy as np
import viser
from numpy.typing import NDArray
from viser import uplot

from balloon_warp.viewer.picture import Picture

SECONDS = 10.0
CURVES = {
    "volume": ("volume [l]", "#c82824", 1000.0),
    "pressure": ("pressure [Pa]", "#1e50dc", 1.0),
    "stretch": ("largest stretch", "#14963c", 1.0),
    "frame": ("frame time [ms]", "#e08a10", 1000.0),
}
"""Label, color, and factor on the measure"""
LEAST_SPAN = 0.02
"""Least range of a plot over the largest value, so that small changes are not magnified"""
STEPS = 0.02
"""Least difference between ticks: the plots have three decimals and about five ticks"""


class Plots:
    """A plot for each measure."""

    def __init__(self, server: viser.ViserServer):
        self._samples: deque[tuple[float, ...]] = deque()
        self._load = 0
        self._plots = {
            name: server.gui.add_uplot(
                data=(np.array([0.0, 1.0]), np.array([0.0, 0.0]), np.array([-1.0, 1.0])),
                # the last is not seen: the axis reaches as far as it does (to set a range makes the plot anew)
                series=(
                    uplot.Series(label="t [s]"),
                    uplot.Series(label=label, stroke=color, width=2),
                    uplot.Series(stroke="transparent", width=0),
                ),
                scales={"x": uplot.Scale(time=False)},
                legend=uplot.Legend(show=False),
                title=label,
                height=120,
            )
            for name, (label, color, _) in CURVES.items()
        }

    def add(self, picture: Picture, measures: dict[str, float]) -> None:
        """Add a sample of each measure; time that ran backward restarts the curves."""
        if picture.load != self._load or (self._samples and picture.seconds < self._samples[-1][0]):
            self._load = picture.load
            self._samples.clear()
        measured = {**measures, "frame": picture.step_seconds}
        sample = {name: factor * measured[name] for name, (_, _, factor) in CURVES.items()}
        if not self._samples or picture.seconds > self._samples[-1][0]:
            self._samples.append((picture.seconds, *(sample[name] for name in CURVES)))
        while self._samples[-1][0] - self._samples[0][0] > SECONDS:
            self._samples.popleft()
        if len(self._samples) > 1:
            times, *curves = np.array(self._samples).T
            for plot, curve in zip(self._plots.values(), curves, strict=True):
                plot.data = (times, curve, np.linspace(*span_of(curve), len(curve)))


def span_of(curve: NDArray[np.floating]) -> tuple[float, float]:
    """Return the range of a plot of values, such that its ticks differ."""
    low, high = float(curve.min()), float(curve.max())
    least = max(LEAST_SPAN * max(abs(low), abs(high)), STEPS)
    middle, half = (low + high) / 2, max(0.55 * (high - low), least / 2)
    return middle - half, middle + half
