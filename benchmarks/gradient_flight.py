"""Errors of gradients against differences in double precision, over ever longer flights: a table, and a picture.

python -m balloon_warp.benchmarks.gradients flight     draws gradient_horizon.png

A ball of springs with a sealed gas flies, or bounces on the ground. The loss is how high its center is in the end.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np

import balloon_warp as bw
from balloon_warp.lab.reference import Reference
from balloon_warp.mesh.topology import quad_sphere

VALUES = {
    "balloon.stiffness.structural": 100.0,
    "balloon.velocity.1": -1.0,
    "balloon.inflation.start_pressure": 500.0,
}
LABELS = ("a stiffness", "a velocity", "the start pressure")
FRAMES = (1, 2, 4, 8, 16, 32, 64, 128, 256)
SUBSTEPS = 32
REACH = 1e-6
"""Half of the difference, over the value"""
PICTURE = "gradient_horizon.png"


def tables() -> Iterator[str]:
    """Yield the errors, and draw them."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    plt.style.use("balloon_warp.studio.charts")
    figure, axes = plt.subplots(1, 2, figsize=(10, 4), sharey=True)
    for axis, grounded in zip(axes, (False, True), strict=True):
        found, told = _measured(grounded)
        off = np.abs(found / told - 1.0)
        for row, frames in enumerate(FRAMES):
            errors = (f"{each:.1e}" for each in off[row])
            yield " ".join([f"{'bounces' if grounded else 'flies'}, {SUBSTEPS * frames:5d} substeps:", *errors])
        axis.loglog(SUBSTEPS * np.array(FRAMES), np.maximum(off, 1e-8), "o-", label=LABELS)
        axis.set(title="bounces on the ground" if grounded else "flies", xlabel="substeps")
        axis.axhline(1e-4, color="gray", linewidth=0.8)
    axes[0].set_ylabel("gradient against difference, relative")
    axes[0].legend(title="by")
    figure.savefig(PICTURE)
    yield PICTURE


def _scene(grounded: bool) -> bw.Scene:
    ball = bw.Balloon(
        mesh=quad_sphere(2, 1.0), position=(0.0, 0.93, 0.0), velocity=(0.3, -1.0, 0.1),
        angular_velocity=(0.5, 1.0, -2.0), mass=0.05, damping=0.02,
        stiffness=bw.Stiffness(structural=100.0, shear=50.0, flexion=20.0),
        inflation=bw.Inflation(kind="gas", start_pressure=500.0),
    )  # fmt: skip
    ground = bw.Ground(height=0.0, friction=0.3) if grounded else None
    return bw.Scene(balloon=[ball], ground=ground, frames=max(FRAMES), substeps=SUBSTEPS)


def _height(moved: bw.Trajectories) -> tuple[float, dict[str, Any]]:
    """Return the mean height of all particles in the end, and the stretch of the ball along x."""
    track = moved.points[0].astype(float)
    slopes = np.zeros(track.shape)
    slopes[-1, :, 1] = 1.0 / track.shape[1]
    slopes[-1, :, 0] = 2.0 * track[-1, :, 0] / track.shape[1]
    return float(track[-1, :, 1].mean() + (track[-1, :, 0] ** 2).mean()), {"points": [slopes]}


def _heights(of: bw.Scene, values: dict[str, float]) -> np.ndarray:
    """Return that loss in the reference, of each frame."""
    reference, heights = Reference(of, values), []
    for _ in range(of.frames):
        reference.frame()
        x, y, _ = reference.points[0].T
        heights.append(y.mean() + (x**2).mean())
    return np.array(heights)


def _measured(grounded: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return gradients and differences of all horizons, by each value."""
    of = _scene(grounded)
    found, told = np.zeros((2, len(FRAMES), len(VALUES)))
    for column, (path, value) in enumerate(VALUES.items()):
        reach = REACH * abs(value)
        sides = [_heights(of, {path: value + sign * reach}) for sign in (1.0, -1.0)]
        told[:, column] = ((sides[0] - sides[1]) / (2.0 * reach))[np.array(FRAMES) - 1]
    for row, frames in enumerate(FRAMES):
        short = of.model_copy(update={"frames": frames})
        gradients = bw.gradient(short, of=list(VALUES), loss=_height, device="cpu").gradients
        found[row] = [gradients[path][0] for path in VALUES]
    return found, told
