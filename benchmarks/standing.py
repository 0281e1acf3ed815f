"""Does a stack of five stand still? Boxes of soft rubber, dropped on each other a little askew, watched for a minute.

    python -m balloon_warp.benchmarks.standing [--seconds 60]

prints every five seconds how far any box is from where it was put, how far any has moved within the last second, and
how deep any particle is in another box; status 1 if a box slipped or moves, or one is in another.
"""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from balloon_warp.benchmarks.overlap import Points, deepest_overlap
from balloon_warp.frame import Frame
from balloon_warp.mesh.topology import quad_sphere
from balloon_warp.scene import Balloon, Ground, Inflation, Scene, Stiffness, Touch
from balloon_warp.simulator import Simulator
from balloon_warp.system.warp_setup import quiet_warp

COUNT = 5
SIZE = 1.0
"""of a box [m]"""
SLIPPED = 0.05
"""from where it was put, the fall and the weight included [m]"""
MOVES = 1e-3
"""within a second, once it has come to rest [m]"""
DEEP = 0.01
"""in another: 2% of half a box [m]"""
SETTLING = 5
"""seconds until it rests"""


def stack() -> Scene:
    """Return the scene of a stack that is a little askew."""
    ball = quad_sphere(4, 1.0)
    mesh = replace(ball, points=0.5 * SIZE * ball.points / np.abs(ball.points).max(axis=1, keepdims=True))
    firm = Stiffness(structural=200.0, shear=100.0, flexion=100.0, viscosity=2e-3)
    box = Balloon(mesh=mesh, mass=0.1, damping=0.1, stiffness=firm, inflation=Inflation(pressure=0.0))
    places = [(0.02 * (-1) ** n, 0.5 + 1.02 * n, 0.01 * n) for n in range(COUNT)]
    boxes = [box.model_copy(update={"position": place}) for place in places]
    return Scene(balloon=boxes, ground=Ground(), touch=Touch(friction=0.5))


def centers(frame: Frame) -> Points:
    """Return the centers [m], shape (COUNT, 3)."""
    return np.array([points.astype(np.float64).mean(axis=0) for points in frame.points])


def main(arguments: Sequence[str] | None = None) -> None:
    """Watch the stack; status 1 if it moves."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--seconds", type=int, default=60)
    told = parser.parse_args(arguments)
    quiet_warp()
    simulator = Simulator(stack(), "cpu")
    meshes = [shape.mesh for shape in simulator.model.shapes]
    start = before = centers(simulator.read_frame())
    stands = True
    for second in range(1, told.seconds + 1):
        for _ in range(round(simulator.model.scene.frames_per_second)):
            simulator.step()
        frame = simulator.read_frame()
        now = centers(frame)
        slipped, moved = np.abs(now - start).max(), np.linalg.norm(now - before, axis=1).max()
        deep = deepest_overlap([points.astype(np.float64) for points in frame.points], meshes)
        stands = stands and slipped < SLIPPED and deep < DEEP and (moved < MOVES or second <= SETTLING)
        before = now
        if second % SETTLING == 0:
            shown = f"{1e3 * slipped:.1f} mm from the start, {1e3 * moved:.2f} mm in a second, {1e3 * deep:.2f} mm deep"
            print(f"{second:3d} s  {shown}", flush=True)
    print("it stands still" if stands else "it does not stand still")
    sys.exit(0 if stands else 1)


if __name__ == "__main__":
    main()
