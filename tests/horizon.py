"""Accuracy of gradients against differences in double precision, over ever longer horizons: `python tests/horizon.py`
draws it.

A ball of springs with a sealed gas flies, or bounces on the ground. The loss is how high its center is in the end."""

import sys
from pathlib import Path

import numpy as np
from gradient_scenes import scene
from reference_runs import run

import balloon_warp as bw

PATHS = ("balloon.stiffness.structural", "balloon.velocity.1", "balloon.inflation.start_pressure")
FRAMES = (1, 2, 4, 8, 16, 32, 64, 128, 256)
REACH = 1e-6
"""Half of the difference, over the value"""
LABELS = ("a stiffness", "a velocity", "the start pressure")


def height(moved: bw.Trajectories) -> tuple[float, dict[str, list[np.ndarray]]]:
    """Return the mean height of all particles in the end, and the stretch of the ball along x."""
    track = moved.points[0].astype(float)
    slopes = np.zeros(track.shape)
    slopes[-1, :, 1] = 1.0 / track.shape[1]
    slopes[-1, :, 0] = 2.0 * track[-1, :, 0] / track.shape[1]
    return float(track[-1, :, 1].mean() + (track[-1, :, 0] ** 2).mean()), {"points": [slopes]}


def height_in_float64(of: bw.Scene, values: dict[str, float]) -> np.ndarray:
    """Return the loss `height` of a run in float64, from each frame."""
    points = run(of, values).points[0]
    return points[..., 1].mean(axis=1) + (points[..., 0] ** 2).mean(axis=1)


def measured(ground: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return gradients and differences of all horizons and paths."""
    of = scene("gas", frames=max(FRAMES), ground=ground, velocity=(0.3, -1.0, 0.1), damping=0.02)
    values = {"balloon.stiffness.structural": 100.0, "balloon.velocity.1": -1.0}
    values["balloon.inflation.start_pressure"] = 500.0
    found, told = np.zeros((2, len(FRAMES), len(PATHS)))
    for column, path in enumerate(PATHS):
        reach = REACH * abs(values[path])
        sides = [height_in_float64(of, {path: values[path] + sign * reach}) for sign in (1.0, -1.0)]
        told[:, column] = ((sides[0] - sides[1]) / (2.0 * reach))[list(FRAMES)]
    for row, frames in enumerate(FRAMES):
        short = of.model_copy(update={"frames": frames})
        gradients = bw.gradient(short, of=PATHS, loss=height, device="cpu").gradients
        found[row] = [gradients[path][0] for path in PATHS]
    return found, told


def main() -> None:
    """Print the errors and draw them."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(10, 4), sharey=True, layout="constrained")
    for axis, ground in zip(axes, (False, True), strict=True):
        found, told = measured(ground)
        off = np.abs(found / told - 1.0)
        for row, frames in enumerate(FRAMES):
            print(f"{'bounces' if ground else 'flies'}, {32 * frames:5d} substeps:", *map("{:.1e}".format, off[row]))
            print("    ", *map("{:.4g}".format, found[row]), "|", *map("{:.4g}".format, told[row]))
        axis.loglog(32 * np.array(FRAMES), np.maximum(off, 1e-8), "o-", label=LABELS)
        axis.set(title="bounces on the ground" if ground else "flies", xlabel="substeps")
        axis.axhline(1e-4, color="gray", linewidth=0.8)
        axis.grid(alpha=0.3)
    axes[0].set_ylabel("gradient against difference, relative")
    axes[0].legend(title="by")
    figure.savefig(Path(sys.argv[1] if len(sys.argv) > 1 else "horizon.png"), dpi=110)


if __name__ == "__main__":
    main()
