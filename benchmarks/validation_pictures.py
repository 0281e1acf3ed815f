"""Pictures of simulations beside formulas."""

from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
from matplotlib import pyplot as plt

CHARTS = "balloon_warp.studio.charts"
"""Style of all charts"""


def draw(case: dict[str, Any], path: Path) -> None:
    """Dots are simulated, lines are formulas. Equal numbers give equal bytes."""
    with plt.style.context(CHARTS):
        figure, axes = plt.subplots(figsize=(7.0, 4.2))
        for number, curve in enumerate(case["curves"]):
            axes.plot(curve["x"], curve["expected"], "-", color=f"C{number}", linewidth=1.2)
            axes.plot(curve["x"], curve["simulated"], "o", color=f"C{number}", label=curve["name"])
        axes.set(title=f"{case['title']}: {case['formula']}", xlabel=case["x_label"], ylabel=case["y_label"])
        if case["logarithmic"]:
            axes.set(xscale="log", yscale="log")
        axes.legend(title="dots: simulated; lines: formula")
        figure.savefig(path, metadata={"Date": None})
        plt.close(figure)
