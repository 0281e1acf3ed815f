"""Pictures of simulations beside formulas."""

from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
from matplotlib import pyplot as plt

COLORS = ("#c8102e", "#1a6fb0", "#e8a200", "#2c8a4b")


def draw(case: dict[str, Any], path: Path) -> None:
    """Dots are simulated, lines are formulas. Equal numbers give equal bytes."""
    with plt.rc_context({"svg.hashsalt": "balloon-warp", "svg.fonttype": "none", "font.family": "sans-serif"}):
        figure, axes = plt.subplots(figsize=(7.0, 4.2))
        for curve, color in zip(case["curves"], COLORS, strict=False):
            axes.plot(curve["x"], curve["expected"], "-", color=color, linewidth=1.2)
            axes.plot(curve["x"], curve["simulated"], "o", color=color, markersize=3.5, label=curve["name"])
        axes.set(title=f"{case['title']}: {case['formula']}", xlabel=case["x_label"], ylabel=case["y_label"])
        if case["logarithmic"]:
            axes.set(xscale="log", yscale="log")
        axes.grid(alpha=0.3)
        axes.legend(title="dots: simulated; lines: formula", frameon=False)
        figure.tight_layout()
        figure.savefig(path, metadata={"Date": None})
        plt.close(figure)
