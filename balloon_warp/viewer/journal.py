"""Journal of the changes to a simulation, frame by frame: the scene that replays it."""

from typing import Any

from balloon_warp.errors import InputError
from balloon_warp.scene import Change, Scene, Sphere, String
from balloon_warp.scene.timeline import frame_at

LONGEST = 20_000
"""Largest number of entries, so that a long session does not fill the memory; then the journal is closed"""


class Journal:
    """Journal of one simulation, from its start.

    Args:
        scene: Scene that it started from.
    """

    def __init__(self, scene: Scene):
        self.base = scene
        self.spheres, self.strings = list(scene.sphere), list(scene.string)
        self.changes: dict[int, dict[str, Any]] = {}
        """New values by their paths, by frame"""
        self.length = 0
        self.closed = False

    def copy(self) -> "Journal":
        """Return a copy of the journal as it is now; later entries go into one of the two."""
        other = Journal(self.base)
        other.spheres, other.strings = list(self.spheres), list(self.strings)
        other.changes = {frame: dict(values) for frame, values in self.changes.items()}
        other.length, other.closed = self.length, self.closed
        return other

    def change(self, frame: int, path: str, value: Any) -> None:
        """Change a value at the start of a frame; of several in one frame the last counts."""
        if not self._full():
            self.changes.setdefault(frame, {})[path] = value

    def add_sphere(self, frame: int, sphere: Sphere) -> int:
        """Add a sphere at the start of a frame, and return its number in the scene that replays."""
        if not self._full():
            self.spheres.append(sphere.model_copy(update={"start": self._time(frame)}))
        return len(self.spheres) - 1

    def add_string(self, frame: int, string: String) -> int:
        """Add a string at the start of a frame, and return its number in the scene that replays."""
        if not self._full():
            self.strings.append(string.model_copy(update={"start": self._time(frame)}))
        return len(self.strings) - 1

    def end(self, bodies: list[Any], number: int, frame: int) -> None:
        """End a sphere or string of this journal at the start of a frame."""
        if not self.closed:
            bodies[number] = bodies[number].model_copy(update={"end": self._time(frame)})

    def forget_what_was_planned(self, frame: int) -> None:
        """Cancel the changes that the scene itself had planned from a frame on."""
        kept = [change for change in self.base.change if frame_at(self.base, change.time) < frame]
        self.base = self.base.model_copy(update={"change": kept})
        kinds: tuple[list[Any], list[Any]] = (self.spheres, self.strings)
        for bodies in kinds:
            for number, body in enumerate(bodies):
                if frame_at(self.base, body.start) >= max(frame, 1):
                    bodies[number] = body.model_copy(update={"end": body.start})
                elif body.end is not None and frame_at(self.base, body.end) >= frame:
                    bodies[number] = body.model_copy(update={"end": None})

    def scene(self, frames: int) -> Scene:
        """Return the scene that replays the journal.

        Raises:
            InputError: too much was done to be kept.
        """
        if self.closed:
            raise InputError(f"the journal of changes is full, at {LONGEST:,} entries; reset first")
        changes = [*self.base.change]
        changes += [Change(time=self._time(frame), set=values) for frame, values in sorted(self.changes.items())]
        update = {"change": changes, "sphere": self.spheres, "string": self.strings, "frames": max(frames, 1)}
        return Scene.model_validate(dict(self.base) | update)

    def _time(self, frame: int) -> float:
        return frame / self.base.frames_per_second

    def _full(self) -> bool:
        self.length += 1
        self.closed = self.closed or self.length > LONGEST
        return self.closed
