"""Sentences on balloons that start crossed, where touching cannot push them apart."""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.crossings import find_crossings
from balloon_warp.mesh.triangles import triangles_of
from balloon_warp.model.parameters import Parameters
from balloon_warp.model.shape import BalloonShape
from balloon_warp.model.starts import start_of
from balloon_warp.scene import Scene

MOST_TRIANGLES = 100_000
"""Largest number of triangles that are looked at, so that a look takes seconds at most"""
ROUNDING = 1e-6
"""Depth that is none, over the size of the balloons"""


def crossed_starts(scene: Scene, shapes: Sequence[BalloonShape], parameters: Parameters) -> list[str]:
    """Return a sentence for each balloon that crosses itself at the start of the first world, and touches itself.

    And one for each two that cross and touch, of which one is open. Closed ones that overlap are pushed apart.
    """
    if not scene.touches or sum(shape.mesh.face_count for shape in shapes) > MOST_TRIANGLES:
        return []
    first = {name: parameters[name][:1] for name in ("initial_turns", "initial_shifts")}
    starts = [start_of(scene, first, number, shape.mesh.points)[0] for number, shape in enumerate(shapes)]
    if scene.touches_itself:
        which: list[tuple[int, ...]] = [(number,) for number in range(len(shapes))]
    else:
        which = []
    which += _overlapping(shapes, starts)
    found = (_sentence(numbers, shapes, starts) for numbers in which)
    return [sentence for sentence in found if sentence]


def _overlapping(shapes: Sequence[BalloonShape], starts: Sequence[NDArray[np.float64]]) -> Iterator[tuple[int, int]]:
    """Yield pairs of balloons, one of them open, whose boxes overlap."""
    lows, highs = (np.array([bound(points, axis=0) for points in starts]) for bound in (np.min, np.max))
    for number, shape in enumerate(shapes):
        for other in range(number):
            apart = (lows[number] > highs[other]) | (lows[other] > highs[number])
            if not apart.any() and not (shape.closed and shapes[other].closed):
                yield other, number


def _sentence(
    numbers: tuple[int, ...], shapes: Sequence[BalloonShape], starts: Sequence[NDArray[np.float64]]
) -> str | None:
    """Describe the crossing of one balloon with itself, or of two; None if nothing crosses."""
    triangles = [triangles_of(shapes[number].mesh) for number in numbers]
    counts = [len(starts[number]) for number in numbers]
    points = np.concatenate([starts[number] for number in numbers])
    found = find_crossings(points, np.concatenate([triangles[0], *(each + counts[0] for each in triangles[1:])]))
    edges_of_first, faces_of_first = found.edges[:, 0] < counts[0], found.triangles < len(triangles[0])
    deep = found.depths > ROUNDING * np.ptp(points, axis=0).max()
    those = np.flatnonzero(deep & ((edges_of_first != faces_of_first) | (len(numbers) == 1)))
    if not len(those):
        return None
    worst = those[found.depths[those].argmax()]
    names = [shapes[number].name for number in numbers]
    who = f"parts of {names[0]} cross each other" if len(names) == 1 else f"{names[0]} and {names[1]} cross"
    faces = len(np.unique(found.triangles[those]))
    place = ", ".join(f"{x:.3g}" for x in found.places[worst])
    passes = "touch.itself = false lets them pass" if len(names) == 1 else "touch.balloons = false lets them pass"
    return (
        f"touch: {who} at the start ({faces:,} face{'s' if faces > 1 else ''}, up to {found.depths[worst]:.2g} m near "
        f"({place})), and stay interlocked there: separate them by touch.thickness, or {passes} through"
    )
