"""Curves of what is measured, over the last seconds."""

from collections import deque

import numpy as np
import viser
from viser import uplot

from balloon_warp.viewer.picture import Picture

SECONDS = 10.0
CURVES = {
    "volume": ("volume [m³]", "#c82824"),
    "pressure": ("pressure [Pa]", "#1e50dc"),
    "stretch": ("largest stretch", "#14963c"),
    "frame": ("a frame takes [ms]", "#e08a10"),
}


class Plots:
    """A plot for each measure."""

    def __init__(self, server: viser.ViserServer):
        self._samples: deque[tuple[float, ...]] = deque()
        self._load = 0
        self._plots = {
            name: server.gui.add_uplot(
                data=(np.array([0.0, 1.0]), np.array([0.0, 0.0])),
                series=(uplot.Series(label="t [s]"), uplot.Series(label=label, stroke=color, width=2)),
                scales={"x": uplot.Scale(time=False)},
                legend=uplot.Legend(show=False),
                title=label,
                height=120,
            )
            for name, (label, color) in CURVES.items()
        }

    def add(self, picture: Picture, measures: dict[str, float]) -> None:
        """One more sample of each; time that ran backward begins the curves anew."""
        if picture.load != self._load or (self._samples and picture.seconds < self._samples[-1][0]):
            self._load = picture.load
            self._samples.clear()
        sample = {**measures, "frame": 1000.0 * picture.step_seconds}
        if not self._samples or picture.seconds > self._samples[-1][0]:
            self._samples.append((picture.seconds, *(sample[name] for name in CURVES)))
        while self._samples[-1][0] - self._samples[0][0] > SECONDS:
            self._samples.popleft()
        if len(self._samples) > 1:
            times, *curves = np.array(self._samples).T
            for plot, curve in zip(self._plots.values(), curves, strict=True):
                plot.data = (times, curve)
