"""Distance of designs from their targets, beside their rivals.

Run it by python -m balloon_warp.benchmarks.design [NAME ...].

A case is its kind, its stretch and its target: springs/any/1.2/pear. latex/thickness/2.0/cube lets the thickness vary,
latex/gravity/1.3/pear is of 3 m and hangs by its top, foil/panels/8/fine_ball has gores, and foil/rim/0.9/heart is an
outline of 0.9 m, or a letter. Targets are analytic shapes on a ball, bundled meshes, and those in the folder that
`BALLOON_WARP_TEST_MESHES` names. Everything is simulated from rest.
"""

import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.lab.design.design import SIZE, Of, design
from balloon_warp.lab.design.springs import Hold
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.load import load_mesh
from balloon_warp.scene import bundled_scenes
from balloon_warp.system.warp_setup import quiet_warp

Points = NDArray[np.float64]


def heart(points: Points) -> Points:
    """Move points of a ball along their rays onto a heart, Y up: Taubin's of 1994, with a shallower cleft."""
    (x, y, z), lengths = points.T, np.linspace(0.0, 1.5, 3001)
    radial, cleft = x**2 + y**2 + 1.6 * z**2, 0.5 * (x**2 + 0.1 * z**2) * y**3
    outside = (radial[:, None] * lengths**2 - 1.0) ** 3 - cleft[:, None] * lengths**5 > 0.0
    return points * lengths[outside.argmax(axis=1)][:, None]


SHAPES: dict[str, Callable[[Points], Points]] = {
    "ellipsoid": lambda x: x * [1.0, 1.0, 1.5],
    "pear": lambda x: x * (1.0 + 0.25 * x[:, 2:]) * [1.0, 1.0, 1.2],
    "peanut": lambda x: x * np.stack([1.0 - 0.35 * np.exp(-6.0 * x[:, 2] ** 2)] * 2 + [np.full(len(x), 1.5)], axis=1),
    "heart": heart,
    "cube": lambda x: x / (np.sum(x**4, axis=1) ** 0.15)[:, None],
}
"""of points on a ball"""
CASES = (
    *(f"springs/{hold}/1.3/{name}" for hold in ("any", "tension") for name in ("ellipsoid", "pear", "peanut", "cube")),
    *(f"springs/any/1.3/{name}" for name in ("squirrel", "spot_quadrangulated")),
    *(f"springs/any/1.2/{name}" for name in ("toy", "squirrel", "knot", "turtle", "spot_quadrangulated")),
    *(f"springs/tension/1.2/{name}" for name in ("toy", "squirrel", "knot", "turtle", "spot_quadrangulated")),
    *(f"latex/tension/{stretch}/{name}" for stretch in (1.3, 2.0, 4.0) for name in ("ellipsoid", "pear")),
    "latex/tension/1.3/spot_quadrangulated",
    *(f"latex/tension/2.0/{name}" for name in ("peanut", "cube", "heart", "toy", "spot_quadrangulated")),
    *(f"latex/thickness/2.0/{name}" for name in ("cube", "toy")),
    *(f"latex/gravity/1.3/{name}" for name in ("ellipsoid", "pear")),
    *(f"foil/panels/{gores}/fine_ball" for gores in (8, 16)),
    "foil/panels/groups/cylinder",
    "foil/panels/marked/squirrel",
    *(f"foil/rim/0.9/{name}" for name in ("circle", "ellipse", "heart", "A")),
)

OUTLINES = {
    "circle": '<circle r="40"/>',
    "ellipse": '<ellipse rx="45" ry="30"/>',
    "heart": '<path d="M 0 35 C -60 -5 -35 -50 0 -20 C 35 -50 60 -5 0 35 Z"/>',
}
"""Drawings of rims, one part each"""
TOP = 0.1
"""Part of the height that is held under gravity"""
MARKED = Path(__file__).parent / "squirrel_seams.txt"
"""of 24 panels, along edges of its faces"""


@dataclass(frozen=True)
class Row:
    """Result of a case."""

    case: str
    said: str
    seconds: float
    worked: float
    """seconds of processors: the time where nothing else runs"""

    def __str__(self) -> str:
        return f"| {self.case} | {self.said} | {self.seconds:.0f} | {self.worked:.0f} |"


def outline(name: str) -> str | Path:
    """Return a rim by its name: the path of its drawing, or the letters that it is."""
    if name not in OUTLINES:
        return name
    drawing = Path(tempfile.mkdtemp(prefix="balloon_outline_")) / f"{name}.svg"
    drawing.write_text(f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="-50 -50 100 100">{OUTLINES[name]}</svg>')
    return drawing


def target(name: str) -> PolygonMesh | Path:
    """Find a target by its name.

    Raises:
        InputError: there is none of this name.
    """
    scenes = next(iter(bundled_scenes().values())).parent
    if name == "cylinder":
        return cylinder()
    if name in SHAPES:
        ball = load_mesh(scenes / "ball.obj")
        points = ball.points - ball.points.mean(axis=0)
        return replace(ball, points=SHAPES[name](points / np.linalg.norm(points, axis=1)[:, None]), name=name)
    folders = [scenes, *(Path(folder) for folder in [os.environ.get("BALLOON_WARP_TEST_MESHES")] if folder)]
    for folder in folders:
        if (folder / f"{name}.obj").is_file():
            return folder / f"{name}.obj"
    raise InputError(f"{name}: no such mesh; BALLOON_WARP_TEST_MESHES may name a folder that has it")


def cylinder(around: int = 32, up: int = 8, across: int = 5) -> PolygonMesh:
    """Return a cylinder, three quarters as high as wide, of two lids and two halves of its side as groups."""
    angles = 2.0 * np.pi * np.arange(around) / around
    ring = np.stack([np.cos(angles), np.zeros(around), np.sin(angles)], axis=1)
    lid = [ring * (1.0 - k / across) for k in range(across)]
    low, high = [0.0, -0.75, 0.0], [0.0, 0.75, 0.0]
    side = [ring + np.array([0.0, 1.5 * k / up - 0.75, 0.0]) for k in range(up + 1)]
    rings = [each + low for each in lid[:0:-1]] + side + [each + high for each in lid[1:]]
    points = np.concatenate([*rings, [low], [high]])
    here = np.arange(around)
    there, last = np.roll(here, -1), (len(rings) - 1) * around
    bands = [np.stack([here, here + around, there + around, there], axis=1) + k * around for k in range(len(rings) - 1)]
    quads, lowest, highest = np.concatenate(bands), len(points) - 2, len(points) - 1
    ends = [np.stack([here, there, np.full(around, lowest)], axis=1)]
    ends += [np.stack([there + last, here + last, np.full(around, highest)], axis=1)]
    first, behind = (across - 1) * around, (across + up) * around
    on_side = np.arange(first, behind).reshape(-1, around)
    half = around // 2
    groups = {
        "bottom": np.append(np.arange(first + around), lowest),
        "top": np.append(np.arange(behind - around, last + around), highest),
        "left": on_side[:, : half + 1].ravel(),
        "right": np.append(on_side[:, half:], on_side[:, :1], axis=1).ravel(),
    }
    return PolygonMesh(
        points,
        np.repeat([4, 3], [len(quads), 2 * around]).astype(np.int32),
        np.concatenate([quads.ravel(), *(each.ravel() for each in ends)]).astype(np.int32),
        "cylinder",
        groups={name: np.unique(vertices).astype(np.int32) for name, vertices in groups.items()},
    )


def asked(how: str, number: str, wanted: PolygonMesh | Path | str) -> dict[str, Any]:
    """Return the arguments that the second and third word of a case stand for."""
    if how == "panels":
        return {"panels": MARKED if number == "marked" else number, "thickness": 1.0e-4, "size": SIZE}
    if how == "rim":
        return {"size": float(number), "thickness": 1.0e-4}
    if how == "gravity":
        assert not isinstance(wanted, str)
        heights = (load_mesh(wanted) if isinstance(wanted, Path) else wanted).points[:, 1]
        top = np.flatnonzero(heights > heights.max() - TOP * np.ptp(heights)).tolist()
        return {"stretch": float(number), "gravity": 9.81, "fixed": top, "size": 3.0}
    of_rubber = {"thickness": (2.0e-4, 8.0e-4)} if how == "thickness" else {"hold": cast(Hold, how)}
    return {"stretch": float(number), "size": SIZE, **of_rubber}


def run(case: str, steps: int = 30) -> Row:
    """Design a case, and time it."""
    of, hold, stretch, name = case.split("/")
    began, idle = time.perf_counter(), time.process_time()
    try:
        wanted = outline(name) if hold == "rim" else target(name)
        found = design(wanted, of=cast(Of, of), steps=steps, device="cpu", **asked(hold, stretch, wanted))
    except InputError as mistake:
        return Row(case, str(mistake), time.perf_counter() - began, time.process_time() - idle)
    said = f"{found.error} | {found.held_error} | {found.plain_error} | {found.stretch:.2f} | {len(found.cannot)}"
    return Row(case, said, time.perf_counter() - began, time.process_time() - idle)


def rows(cases: list[str]) -> Iterator[Row]:
    """Iterate over the rows of some cases, or of all."""
    return (run(case) for case in cases or CASES)


if __name__ == "__main__":
    quiet_warp()
    print("| case | simulated from rest | as designed | plain | stretch reached | places off | s | s of processors |")
    print("|---|---|---|---|---|---|---|---|")
    for row in rows(sys.argv[1:]):
        print(row, flush=True)
