"""The scene over time: the times of its spheres and strings, and its changes."""

from collections.abc import Iterator
from math import ceil

from balloon_warp.errors import InputError
from balloon_warp.scene.load import override_scene
from balloon_warp.scene.schema import Scene, Sphere, String


def frame_at(scene: Scene, seconds: float) -> int:
    """Find the first frame that is not before a time; times that rounding puts a little after a frame belong to it."""
    return ceil(seconds * scene.frames_per_second - 1e-6)


def is_there(scene: Scene, lasting: Sphere | String, frame: int) -> bool:
    """Return whether a sphere or string of the scene has appeared by a frame, and has not ended."""
    ended = lasting.end is not None and frame >= frame_at(scene, lasting.end)
    return frame >= frame_at(scene, lasting.start) and not ended


def scenes_over_time(scene: Scene) -> Iterator[tuple[int, Scene]]:
    """Find the frames at which something changes, appears or ends, in order, and the scene from then on.

    Raises:
        InputError: names the change, and the path or field that is wrong.
    """
    changes = [(frame_at(scene, change.time), number) for number, change in enumerate(scene.change)]
    frames = {frame for frame, _ in changes}
    for lasting in (*scene.sphere, *scene.string):
        frames |= {frame_at(scene, time) for time in (lasting.start, lasting.end) if time}
    now = scene.model_copy(update={"change": []})
    for frame in sorted(frames):
        for number in [number for at, number in changes if at == frame]:
            try:
                now = override_scene(now, scene.change[number].set.items())
            except InputError as mistake:
                raise InputError(f"change.{number}.set: {mistake}") from None
        yield frame, now
