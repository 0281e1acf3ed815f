"""Check of a stage for crossings, frame by frame."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import warp as wp
from pxr import Usd, UsdGeom

from balloon_warp.arguments import checked
from balloon_warp.checking.moments import Checker, Met
from balloon_warp.checking.things import Surface, things_of
from balloon_warp.device import pick_device
from balloon_warp.errors import InputError
from balloon_warp.mesh.usd_open import open_meshes
from balloon_warp.outputs.render.stage_reader import left_out
from balloon_warp.outputs.render.timing import timing_of
from balloon_warp.outputs.usd import STAGE_SUFFIXES
from balloon_warp.shown import Shown, described
from balloon_warp.suggestions import did_you_mean_file

THICKNESS = 0.05
"""Default thickness of a balloon's skin over its mean edge, to which depth it may be in a solid; see `[touch]`"""
BLURS = 10.0
"""Depth over the rounding of places below which balloons only touch"""


@dataclass(frozen=True)
class Crossing:
    """Crossing of two things at a frame, with its deepest place."""

    frame: int
    first: str
    """Name of a thing, such as "balloon ball"; for parts of one balloon both are the same"""
    second: str
    place: tuple[float, float, float]
    """Place of the largest depth [m]"""
    depth: float
    """Depth: displacement along a face's normal that frees it from the other thing [m]"""

    def __str__(self) -> str:
        place = ", ".join(f"{number:.4g}" for number in self.place)
        other = "itself" if self.first == self.second else self.second
        return f"frame {self.frame}: {self.first} penetrates {other} by {self.depth:.3g} m at ({place})"


@described
@dataclass(frozen=True, repr=False)
class CheckReport(Shown):
    """Result of a check."""

    stage: str
    frames: int
    """Number of frames checked"""
    things: tuple[str, ...]
    """Things that were checked"""
    triangles: int
    within: float
    """Tolerated depth of balloons in solids [m]"""
    crossings: tuple[Crossing, ...]
    """Crossings of each frame and each pair of things, by frame"""

    @property
    def passed(self) -> bool:
        """Return whether nothing crosses."""
        return not self.crossings


@checked
def check_stage(
    path: str | Path,
    *,
    frames: tuple[int | None, int | None] | None = None,
    within: float | None = None,
    device: str | wp.Device | None = None,
    on_frame: Callable[[int, int], None] | None = None,
    on_note: Callable[[str], None] = lambda sentence: None,
) -> CheckReport:
    """Check a stage for interpenetration of balloons, their parts, obstacles, bodies, spheres and the ground.

    Args:
        path: Any file that USD opens. Deformable meshes count as balloons.
        frames: First and last frame to check; all if not given.
        within: Tolerated depth of a balloon in a solid [m]; a twentieth of its mean edge if not given.
        device: Device for the check, such as "cpu".
        on_frame: Called with the number of frames done, and of all.
        on_note: Called with sentences on missing files and images of the stage, and on shapes that are not checked.

    Raises:
        InputError: The stage cannot be read, or has nothing that could cross.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: no such file; expected a USD stage{did_you_mean_file(path, STAGE_SUFFIXES)}")
    if within is not None and not 0.0 <= within < np.inf:
        raise InputError(f"within: {within:g}; expected at least 0 m")
    opened = open_meshes(path, rounds=False)
    for sentence in (*opened.warnings, *left_out(opened.stage)):
        on_note(sentence)
    stage, first, last, _rate = timing_of(opened.stage, path)
    numbers = _chosen(path, range(first, last + 1), frames)
    unit = UsdGeom.GetStageMetersPerUnit(stage)
    things = things_of(stage, [Usd.TimeCode(number) for number in numbers])
    if len(things) < 2 and not any(isinstance(each, Surface) for each in things):
        raise InputError(f"{path}: has nothing to check; expected meshes or solid shapes")
    checker = Checker(things, unit, pick_device(device))
    allowed = within if within is not None else _thickness(checker, Usd.TimeCode(numbers[0]), unit)
    found: list[Crossing] = []
    for done, number in enumerate(numbers):
        met = checker.look(Usd.TimeCode(number))
        found += [_crossing(number, each) for each in met if each.depth > _allowed(each, allowed, checker.blur)]
        if on_frame:
            on_frame(done + 1, len(numbers))
    return CheckReport(
        str(path), len(numbers), tuple(thing.said for thing in things), checker.triangle_count, allowed, tuple(found)
    )


def _chosen(path: Path, known: range, frames: tuple[int | None, int | None] | None) -> range:
    """Return the requested ones of the known frames."""
    first, last = frames or (None, None)
    begin = known.start if first is None else first
    end = known[-1] if last is None else last
    if begin not in known or end not in known or begin > end:
        span = f"{known.start} to {known[-1]}"
        raise InputError(f"{path}: has frames {span}; expected a range within (got {begin}:{end})")
    return range(begin, end + 1)


def _thickness(checker: Checker, time: Usd.TimeCode, unit: float) -> float:
    """Return a twentieth of the mean edge of all balloons [m]; 0 without any."""
    lengths = [np.zeros(0)]
    for surface in checker.surfaces:
        if surface.soft:
            corners = surface.at(time, unit)[surface.triangles]
            lengths += [np.linalg.norm(corners[:, end] - corners[:, end - 1], axis=1) for end in range(3)]
    edges = np.concatenate(lengths)
    return THICKNESS * float(edges.mean()) if len(edges) else 0.0


def _allowed(met: Met, thickness: float, blur: float) -> float:
    """Return the tolerated depth of two things in each other [m]."""
    balloons = [each.kind == "balloon" for each in (met.first, met.second)]
    return BLURS * blur if all(balloons) else max(thickness, blur)


def _crossing(frame: int, met: Met) -> Crossing:
    x, y, z = met.place.tolist()
    return Crossing(frame, met.first.said, met.second.said, (x, y, z), met.depth)
