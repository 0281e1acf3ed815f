"""A preview from Blender's side: balloons that play live while values are dragged."""

from pathlib import Path

import bpy
from bpy.types import Context, Scene

from . import baking, modifiers, properties, tears
from .reading import read_scene
from .request import LIVE, write_request
from .snapshot import RefusedError, Snapshot
from .worker import Worker

MOST_POINTS = 3000
"""Points of all balloons that play live"""
SECONDS = 1.0 / 24.0
"""Interval between pictures [s]"""
PATHS = {"pressure": "inflation.pressure", "lift": "helium", "damping": "damping"}
"""Fields of a balloon that follow a property while it is dragged"""


class Preview(Worker):
    """A preview that runs.

    Args:
        scene: with the balloons.
        folder: with the request.
        snapshot: that it was made of.
        files: Names of the caches of its things, empty for those without.
    """

    def __init__(self, scene: Scene, folder: Path, snapshot: Snapshot, files: list[str]):
        super().__init__("preview", folder)
        self.scene_name, self._playing, self._error = scene.name, False, ""
        named = [(thing.name, file) for thing, file in zip(snapshot.things, files, strict=True) if file]
        self._files = {name: folder / f"{LIVE}{file}" for name, file in named}
        self._balloons = [thing.name for thing in snapshot.things if thing.role == "BALLOON"]
        players = {path: modifiers.player(scene, name) for name, path in self._files.items()}
        self._before = {path: modifiers.state(modifiers.add(thing)) for path, thing in players.items() if thing}
        """Modifiers before it by what they play, for afterwards: objects may get other names"""
        self._told = self._values(scene)

    def poll(self) -> bool:
        """Send values that were dragged, and show the latest frame; return whether it goes on."""
        ended, heard = self.ended, self.hear()
        if not (scene := bpy.data.scenes.get(self.scene_name)):
            return False
        if heard and not self._playing and all(path.exists() for path in self._files.values()):
            self._playing = True
            for name, path in self._files.items():
                if thing := modifiers.player(scene, name):
                    baking.play(scene, thing, path)
                    tears.show(thing, torn=False)
        modifiers.refresh(scene)
        values = self._values(scene)
        if changed := {path: value for path, value in values.items() if self._told.get(path) != value}:
            self._told = values
            self.tell(changed)
        self._error = next((line["error"] for line in heard if "error" in line), self._error)
        if ended:
            baking.say(scene, self._error or f"The preview ended: {self.last_error()}", is_error=True)
        return not ended

    def close(self) -> None:
        """End the preview; its objects play their caches of before."""
        self.stop()
        if scene := bpy.data.scenes.get(self.scene_name):
            for thing in scene.objects:
                path, found = modifiers.cache_of(thing), modifiers.find(thing)
                if path in self._before and found:
                    modifiers.restore(found, self._before[path])
                    tears.show(thing, torn=True)
        for path in self._before:
            path.unlink(missing_ok=True)

    def _values(self, scene: Scene) -> dict[str, float]:
        """Return the values that can be dragged, by their paths in the simulated scene."""
        found = {}
        for number, name in enumerate(self._balloons):
            if not (thing := modifiers.player(scene, name)):
                continue
            settings = properties.of(thing)
            for field, path in PATHS.items():
                if field != "pressure" or settings.inflate == "PRESSURE":
                    found[f"balloon.{number}.{path}"] = getattr(settings, field)
        return found


running: Preview | None = None
"""The preview that runs, of which there is one at a time"""


def start(context: Context) -> None:
    """Begin a preview of the scene.

    Raises:
        RefusedError: something cannot be simulated, is too large, or a bake runs.
    """
    global running
    baking.require_none()
    snapshot = read_scene(context)
    points = sum(len(thing.points) for thing in snapshot.things if thing.role == "BALLOON")
    if points > MOST_POINTS:
        raise RefusedError(f"{context.scene.name}: its balloons have {points} vertices; expected {MOST_POINTS} at most")
    for thing in snapshot.things:
        thing.settings["burst"] = "NEVER"  # who drags wants to see it whole
    folder = Path(bpy.app.tempdir) / "balloon_warp_preview"
    try:
        files = write_request(folder, snapshot)
        running = Preview(context.scene, folder, snapshot, files)
    except OSError as error:
        raise RefusedError(f"{folder}: cannot be written: {error.strerror}") from None
    bpy.app.timers.register(watch, first_interval=SECONDS)


def watch() -> float | None:
    """Follow the preview that runs, as a timer of Blender's."""
    if running and not running.poll():
        stop()
    baking.redraw()
    return SECONDS if running else None


def stop() -> None:
    """End the preview that runs."""
    global running
    if running:
        ended, running = running, None
        ended.close()
