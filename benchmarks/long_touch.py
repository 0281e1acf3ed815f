"""Does anything come through anything? A bundled scene simulated for long, looked at now and then.

    python -m balloon_warp.benchmarks.long_touch balloon_pit [--frames 10000] [--every 250]

prints after each so many frames how deep any particle is in another balloon, in another part of its own where balloons
touch themselves, and in obstacles of the shapes box and capsule, in parts of the first balloon's radius; then whether
anything came deeper than is allowed, with status 1 if so. While a scene begins it is looked at every 30 frames.
"""

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from balloon_warp.benchmarks.overlap import Points, deepest_in_itself, deepest_overlap
from balloon_warp.frame import Frame
from balloon_warp.mesh.topology import signed_volume, total_area
from balloon_warp.model import Model
from balloon_warp.model.touch import APART, edge_length
from balloon_warp.scene import load_scene
from balloon_warp.simulator import Simulator
from balloon_warp.system.warp_setup import quiet_warp

ALLOWED = 0.02
"""of a balloon's radius, that anything may be in anything"""
BEGINNING, OFTEN = 300, 30
"""frames, and how often they are looked at"""
ROUNDING = 2e-5
"""float32's, of points on a surface a meter from the origin [m]"""


@dataclass(frozen=True)
class Look:
    """Depths of all that may touch, at a frame [m]."""

    frame: int
    others: float
    """particles in other balloons"""
    itself: float
    """in other parts of their own"""
    obstacles: float

    @property
    def deepest(self) -> float:
        return max(self.others, self.itself, self.obstacles)


def look_at(model: Model, frame: Frame, number: int) -> Look:
    """Measure the depths of all that may touch."""
    parts = [points.astype(np.float64) for points in frame.points]
    meshes = [shape.mesh for shape in model.shapes]
    itself = 0.0
    if model.scene.touches_itself:
        pairs = zip(parts, meshes, strict=True)
        itself = max(deepest_in_itself(part, mesh, APART * edge_length(mesh)) for part, mesh in pairs)
    everything = np.concatenate(parts)
    inside = [-distances_to(model, frame, shape, everything).min() for shape in range(len(model.obstacles))]
    return Look(number, deepest_overlap(parts, meshes), itself, max([0.0, *inside]))


def distances_to(model: Model, frame: Frame, number: int, points: Points) -> Points:
    """Return the distances of points from a box or capsule [m], negative in it; infinite for other obstacles."""
    shape, pose = model.obstacles[number], frame.obstacle_poses[number]
    seen = turned_back(pose[3:], points - pose[:3])
    if shape.kind == "box":
        beyond = np.abs(seen) - shape.size
        return np.linalg.norm(np.maximum(beyond, 0.0), axis=1) + np.minimum(beyond.max(axis=1), 0.0)
    if shape.kind == "capsule":
        up = np.array(model.scene.up)
        along = np.clip(seen @ up, -shape.size[1], shape.size[1])
        return np.linalg.norm(seen - along[:, None] * up, axis=1) - shape.size[0]
    return np.full(len(points), np.inf)


def turned_back(turn: Points, points: Points) -> Points:
    """Turn points back by a quaternion (x, y, z, w)."""
    axis = -turn[:3]
    aside = 2.0 * np.cross(axis, points)
    return points + turn[3] * aside + np.cross(axis, aside)


def radius_of(model: Model) -> float:
    """Return the radius of the first balloon at the start, as if it were a tube: two thirds of a ball's [m]."""
    mesh = model.shapes[0].mesh
    return 2.0 * abs(signed_volume(mesh)) / total_area(mesh)


def long_look(name: str, frames: int, every: int) -> float:
    """Print a line for each look; the deepest of all, over a radius."""
    simulator = Simulator(load_scene(name), "cpu")
    radius, deepest, begun = radius_of(simulator.model), 0.0, time.process_time()
    for number in range(1, frames + 1):
        simulator.step()
        if number % every == 0 or (number <= BEGINNING and number % OFTEN == 0):
            look = look_at(simulator.model, simulator.read_frame(), number)
            deepest = max(deepest, look.deepest - ROUNDING)
            shown = [f"{100.0 * depth / radius:6.2f}%" for depth in (look.others, look.itself, look.obstacles)]
            spent = (time.process_time() - begun) / number
            print(f"{number:7,}  {'  '.join(shown)}  {1000.0 * spent:6.1f} ms of CPU a frame", flush=True)
    return deepest / radius


def main(arguments: Sequence[str] | None = None) -> None:
    """Look at a scene; status 1 where anything comes too deep into anything."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("scene", help="the name of a bundled scene, or a file")
    parser.add_argument("--frames", type=int, default=10_000)
    parser.add_argument("--every", type=int, default=250, help="frames between two looks")
    told = parser.parse_args(arguments)
    quiet_warp()
    print(f"{Path(told.scene).stem}: in other balloons, in itself, in obstacles, over its radius")
    deepest = long_look(told.scene, told.frames, told.every)
    print(f"deepest, less float32's rounding: {100.0 * deepest:.2f}% of its radius; {100.0 * ALLOWED:g}% allowed")
    sys.exit(1 if deepest > ALLOWED else 0)


if __name__ == "__main__":
    main()
