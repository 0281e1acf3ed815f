"""Bakes as Blender sees them: a process, its messages so far, and the message on the panel."""

import json
import shutil
from collections.abc import Sequence
from pathlib import Path

import bpy
from bpy.types import Context, Object, Scene

from . import modifiers, properties, tears
from .reading import read_scene
from .request import FILES, tears_of, write_request
from .snapshot import RefusedError
from .worker import ERRORS, TOLD, Worker

SECONDS = 0.2
"""Interval between looks at what the process tells [s]"""
FLOAT = 4
"""Bytes of a number"""


class Bake(Worker):
    """A bake that runs.

    Args:
        scene: with the balloons.
        folder: with the request.
        resume: whether it goes on from a checkpoint.
        remarks: Sentences for the panel.
    """

    def __init__(self, scene: Scene, folder: Path, resume: bool, remarks: Sequence[str] = ()):
        super().__init__("bake", folder, "--attached", *(["--resume"] if resume else []))
        self.scene_name = scene.name
        self.frame, self.frames, self.left = 0, scene.frame_end - scene.frame_start, None
        """Frames done and wanted, and the seconds left"""
        self.cancelled, self._end, self._warnings = False, "", list(remarks)

    def poll(self) -> bool:
        """Show the messages of the process; return whether it goes on."""
        ended, before = self.ended, self.frame
        for line in self.hear():
            if "frame" in line:
                self.frame, self.frames, self.left = line["frame"], line["of"], line["left"]
            self._warnings += [line["warning"]] if "warning" in line else []
            self._end = line.get("error", self._end)
        if scene := bpy.data.scenes.get(self.scene_name):
            if self.frame != before or ended:
                show(scene)
            say(scene, *self._said(ended), "\n".join(self._warnings))
        return not ended

    def cancel(self) -> None:
        """Ask the process to stop; it writes a checkpoint first."""
        self.cancelled = True
        self.ask_to_end()

    def _said(self, ended: bool) -> tuple[str, bool]:
        """Return the sentence of the panel, and whether it is an error."""
        if not ended:
            if self.left is None:
                return "Preparing; the first bake of its kind compiles for up to a minute", False
            return f"Frame {self.frame} of {self.frames}, {self.left:.0f} s left", False
        if self._end:
            return self._end, True
        if self.process.returncode == 0:
            return f"Baked {self.frames} frames", False
        if self.cancelled:
            return f"Cancelled at frame {self.frame}; Continue goes on from there", False
        return f"The bake ended at frame {self.frame}: {self.last_error()}; Continue goes on", True


running: Bake | None = None
"""The bake that runs, of which there is one at a time"""


def start(context: Context) -> Bake:
    """Write the request of a scene, and begin its bake; its balloons play it from now on.

    Raises:
        RefusedError: something cannot be baked, or another bake runs.
    """
    require_none()
    scene, snapshot = context.scene, read_scene(context)
    folder = folder_of(scene)
    try:
        shutil.rmtree(folder / "partial", ignore_errors=True)
        for path in folder.glob("*.torn"):
            path.unlink()
        files = write_request(folder, snapshot)
        begun = begin(scene, folder, resume=False, remarks=snapshot.remarks)
    except OSError as error:
        raise RefusedError(f"{folder}: cannot be written: {error.strerror}") from None
    for each, cache in modifiers.caches_of(scene).items():
        if cache.parent == folder and cache.name not in files:
            rest(each)  # which takes part no more
    for thing, file in zip(snapshot.things, files, strict=True):
        if file and (found := modifiers.player(scene, thing.name)):
            play(scene, found, folder / file)
            tears.remove(found)
            if thing.bursts:
                tears.add(found, len(thing.counts))
    return begun


def resume(scene: Scene) -> Bake:
    """Go on with the bake of a scene that was stopped; its balloons play it, also if they did not.

    Raises:
        RefusedError: another bake runs, or the request cannot be read.
    """
    folder = folder_of(scene)
    try:
        asked = json.loads((folder / FILES[0]).read_text(encoding="utf-8"))
        begun = begin(scene, folder, resume=True)
    except (OSError, ValueError) as error:
        raise RefusedError(f"{folder}: cannot be read: {error}; expected a bake to go on with") from None
    for each in asked["things"]:
        if each["file"] and (found := modifiers.player(scene, each["name"])):
            play(scene, found, folder / each["file"])
            if not tears.find(found) and (torn := tears_of(folder / each["file"])).exists():
                tears.add(found, torn.stat().st_size // FLOAT)
    return begun


def play(scene: Scene, thing: Object, cache: Path) -> None:
    """Let an object play its cache."""
    modifiers.play(modifiers.add(thing), cache, scene.frame_start)


def rest(thing: Object) -> None:
    """Let an object play nothing."""
    if found := modifiers.find(thing):
        modifiers.rest(found)
    tears.remove(thing)


def show(scene: Scene) -> None:
    """Show the finished frames of a running bake."""
    tears.refresh(scene)
    modifiers.refresh(scene)


def begin(scene: Scene, folder: Path, resume: bool, remarks: Sequence[str] = ()) -> Bake:
    """Begin the process of a bake, or go on with one that was stopped.

    Raises:
        RefusedError: another bake runs.
    """
    global running
    require_none()
    running = Bake(scene, folder, resume, remarks)
    if not bpy.app.timers.is_registered(watch):
        bpy.app.timers.register(watch, first_interval=SECONDS)
    return running


def require_none() -> None:
    """Make sure that no bake runs.

    Raises:
        RefusedError: one does.
    """
    if running:
        raise RefusedError(f"{running.scene_name}: is being baked; expected the end of that bake, or Cancel")


def watch() -> float | None:
    """Follow the bake that runs, as a timer of Blender's."""
    global running
    if running and not running.poll():
        running = None
    redraw()
    return SECONDS if running else None


def stop() -> None:
    """End the bake that runs, and wait for it, as when its file is closed."""
    global running
    if running:
        running.cancelled = True
        running.stop()
        running.poll()
        running = None


def delete(scene: Scene) -> None:
    """Delete a scene's bake: its objects are as they were before it."""
    folder = folder_of(scene)
    for thing in scene.objects:
        rest(thing)
    for path in (*(folder / name for name in (*FILES, TOLD, ERRORS)), *folder.glob("*.pc2"), *folder.glob("*.torn")):
        path.unlink(missing_ok=True)
    shutil.rmtree(folder / "partial", ignore_errors=True)
    for empty in (folder, folder.parent):
        if empty.is_dir() and not any(empty.iterdir()):
            empty.rmdir()
    say(scene, "")


def folder_of(scene: Scene) -> Path:
    """Return the folder of a scene's bake: beside its .blend, else of temporary files.

    Its balloons may play another: a file that was saved under a new name plays the bake of the old one until its own.
    """
    if bpy.data.filepath:
        return beside(Path(bpy.data.filepath), scene)
    return temporary() / scene.name


def temporary() -> Path:
    """Return the folder of bakes of files that were not saved."""
    return Path(bpy.app.tempdir) / "balloon_warp"


def beside(blend: Path, scene: Scene) -> Path:
    """Return the folder of a scene's bake beside its .blend."""
    return blend.parent / "balloon_warp" / f"{blend.stem}_{scene.name}"


def can_continue(scene: Scene) -> bool:
    """Return whether a bake of the scene was stopped, and can go on."""
    return not running and has_checkpoint(folder_of(scene))


def has_checkpoint(folder: Path) -> bool:
    """Return whether a bake in a folder can go on."""
    return any((folder / "partial").glob("rows_*.npz"))


def move_beside(blend: str) -> None:
    """Move bakes of temporary files beside the .blend that is about to be saved first; one that runs goes on there."""
    for scene in bpy.data.scenes if blend and not bpy.data.filepath else ():
        folder, there = temporary() / scene.name, beside(Path(blend), scene)
        goes_on = running is not None and running.folder == folder
        if not goes_on and folder not in (path.parent for path in modifiers.caches_of(scene).values()):
            continue
        if goes_on:
            stop()
        shutil.rmtree(there, ignore_errors=True)
        shutil.move(folder, there)
        for thing, path in modifiers.caches_of(scene).items():
            if path.parent == folder:
                relative = bpy.path.relpath(str(there / path.name), start=str(Path(blend).parent))
                modifiers.move(thing, relative)
        if goes_on:
            begin(scene, there, resume=True)


def stay_with_copy(blend: str) -> None:
    """Let balloons of a file that was not saved, but for a copy, play the bake beside the copy."""
    for scene in bpy.data.scenes if blend and not bpy.data.filepath else ():
        for thing in scene.objects:
            if (found := modifiers.find(thing)) and found.filepath:
                modifiers.move(thing, bpy.path.abspath(found.filepath, start=str(Path(blend).parent)))


def say(scene: Scene, message: str, is_error: bool = False, remarks: str = "") -> None:
    """Keep a sentence on the scene's panel, and remarks on its meshes, a line each."""
    shown = properties.of(scene)
    shown.message, shown.is_error, shown.remarks = message, is_error, remarks


def redraw() -> None:
    """Let Blender draw its views and panels again."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type in ("VIEW_3D", "PROPERTIES"):
                area.tag_redraw()


def inflate(thing: Object) -> None:
    """Make a balloon of an object."""
    properties.of(thing).role = "BALLOON"
    modifiers.add(thing)
