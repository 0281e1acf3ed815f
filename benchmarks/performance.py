"""Chart of the speed, from the measurements that RESULTS.md keeps.

Run it in the project's folder, by python -m balloon_warp.benchmarks.performance docs/pictures/performance.svg.
"""

import sys
from pathlib import Path

RESULTS = Path("benchmarks/RESULTS.md")
GPU_FRAME = 488 * 32
"""particle-substeps in a frame of the cases' balloon"""
SHOWN = {
    "springs and the paper's push": ("4,096 balloons", "block"),
    "the same, with pressure normals updated every substep": ("4,096 balloons, fresh normals", "block"),
    "a sealed gas, and drag in air": ("4,096 balloons, sealed gas", "block"),
    "latex that wrinkles, with a sealed gas": ("4,096 balloons of neo-Hookean rubber", ""),
    "under pressure, lying on a box": ("4,096 balloons on a box", ""),
    "under pressure, eight packed in a box": ("1,024 worlds of eight balloons that touch, packed in a box", ""),
}
"""their names in docs/PERFORMANCE.md, and the rows' case and schedule"""


def rates(results: str) -> dict[str, tuple[float, float | None]]:
    """Million balloon frames a second on one GPU, and Newton's, of shown cases; the first row of a name counts."""
    rows = [[cell.strip().strip("`") for cell in line.split("|")[1:-1]] for line in results.splitlines() if "|" in line]
    found = {}
    for name, (case, schedule) in SHOWN.items():
        row = next(row for row in rows if row[0] == case and (not schedule or row[1] == schedule))
        rate = row[4] if schedule else row[1]
        peer = float(row[6]) / GPU_FRAME / 1e6 if schedule and row[5] == "newton" else None
        found[name] = (float(rate) / GPU_FRAME / 1e6, peer)
    return found


def draw(path: Path) -> None:
    """Bars, on a logarithmic axis. Equal numbers give equal bytes."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    found = rates(RESULTS.read_text(encoding="utf-8"))
    with plt.style.context("balloon_warp.studio.charts"):
        figure, axes = plt.subplots(figsize=(8.0, 3.6))
        for place, (ours, peer) in enumerate(found.values()):
            for height, rate, color in ((place - 0.18, ours, "C0"), (place + 0.18, peer, "C5")):
                if rate is not None:
                    axes.barh(height, rate, 0.34, color=color)
                    axes.text(rate * 1.05, height, f"{rate:.2g}", va="center", fontsize=9)
        axes.set_yticks(range(len(found)), [name.replace(", ", ",\n") for name in found])
        axes.invert_yaxis()
        axes.set(xscale="log", xlim=(0.05, 15.0), xlabel="million balloon frames a second on one NVIDIA H100")
        title = "Balloon Warp (red) and Newton 1.8 (gray), balloons of 488 particles"
        figure.suptitle(title, x=0.01, horizontalalignment="left", fontsize=11)
        axes.grid(axis="y", visible=False)
        figure.savefig(path, metadata={"Date": None})
        plt.close(figure)


if __name__ == "__main__":
    draw(Path(sys.argv[1] if len(sys.argv) > 1 else "docs/pictures/performance.svg"))
