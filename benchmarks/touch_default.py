"""Rates of scenes in which balloons touch by default and are apart, over those with `touch = false`.

`python -m balloon_warp.benchmarks.touch_default [DEVICE [WORLDS]]` prints them, in turns; of one world on the CPU where
nothing is said.
"""

import sys
import time

import numpy as np
import warp as wp

from balloon_warp import Simulator, load_scene
from balloon_warp.mesh import PolygonMesh


def tube(rings: int, around: int) -> PolygonMesh:
    """Return a closed tube, 2 m long and 16 cm wide, which touches itself by default."""
    along, angles = np.linspace(-1.0, 1.0, rings), 2.0 * np.pi * np.arange(around) / around
    points = [(x, 0.08 * np.cos(a), 0.08 * np.sin(a)) for x in along for a in angles]
    one, first = np.arange(around), around * np.arange(rings - 1)[:, None]
    other, last = np.roll(one, -1), around * (rings - 1)
    quads = np.stack([first + one, first + other, first + around + other, first + around + one], axis=-1)
    left = np.stack([np.full(around, len(points)), other, one], axis=-1)
    right = np.stack([np.full(around, len(points) + 1), last + one, last + other], axis=-1)
    return PolygonMesh(
        points=np.array([*points, (-1.04, 0.0, 0.0), (1.04, 0.0, 0.0)]),
        face_vertex_counts=np.array([4] * (quads.size // 4) + [3] * (2 * around), np.int32),
        face_vertex_indices=np.concatenate([quads.ravel(), left.ravel(), right.ravel()]).astype(np.int32),
    )


SCENES: dict[str, str | PolygonMesh] = {
    **{name: name for name in ("two_balloons", "helium_rise", "latex_inflate", "two_latex_balloons")},
    **{f"a tube of {rings * around + 2:,} vertices": tube(rings, around) for rings, around in ((17, 12), (101, 24))},
}
ROUNDS = 3
"""Number of runs each; the first, in which kernels load, is not counted"""


def frames_per_second(source: str | PolygonMesh, touches: bool, device: str, worlds: int) -> float:
    """Return the rate at which a scene plays from its second frame on, of a CPU by the processor's time."""
    simulator = Simulator(load_scene(source, {} if touches else {"touch": False}), device, worlds)
    clock = time.process_time if device == "cpu" else time.perf_counter
    simulator.step()
    begin, frames = clock(), simulator.model.scene.frames - 1
    for _ in range(frames):
        simulator.step_unread()
    simulator.read_frame()
    wp.synchronize_device(device)
    return frames / (clock() - begin)


def main() -> None:
    """Print a line a scene."""
    device = sys.argv[1] if len(sys.argv) > 1 else "cpu"
    worlds = int(sys.argv[2]) if len(sys.argv) > 2 else 1
    for name, source in SCENES.items():
        rates = [
            [frames_per_second(source, touches, device, worlds) for touches in (False, True)] for _ in range(ROUNDS)
        ]
        apart, touching = (max(column) for column in zip(*rates[1:], strict=True))
        print(f"{name}: {apart:.0f} frames/s with touch = false, {touching:.0f} without, {touching / apart:.2f}")


if __name__ == "__main__":
    main()
