"""Velocities as a stage has them: of the points in it, so that motion blur follows the visible motion.

A simulated velocity is that of one substep. It trembles with vibrations that no frame shows, but motion blur would.
"""

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Vt


def author_velocities(target: Sdf.Layer, velocities: Sdf.Path, source: Sdf.Layer, points: Sdf.Path, frame: int) -> None:
    """Write the velocities of a frame, if its points are there, as central differences in time [m/s].

    Where a neighbor is missing, as at the first and the last frame, the difference from or to the other; where both
    are, 0.

    Args:
        target: Layer to write to.
        velocities: Attribute of it.
        source: Layer with the points of the frames; it has the same frame rate.
        points: Attribute of it.
        frame: Number of the frame.
    """
    here = _points(source, points, frame)
    if here is None:
        return
    earlier, later = (_points(source, points, neighbor) for neighbor in (frame - 1, frame + 1))
    frames = (earlier is not None) + (later is not None)
    last, first = here if later is None else later, here if earlier is None else earlier
    way = np.subtract(last, first, dtype=np.float64)  # of float32: it loses nothing
    way *= source.timeCodesPerSecond / max(frames, 1)
    target.SetTimeSample(velocities, frame, Vt.Vec3fArray.FromNumpy(way.astype(np.float32)))


def _points(layer: Sdf.Layer, path: Sdf.Path, frame: int) -> NDArray[np.float32] | None:
    """Return the points of a frame, shape (point_count, 3)."""
    value = layer.QueryTimeSample(path, frame)
    return None if value is None else np.asarray(value).reshape(-1, 3)
