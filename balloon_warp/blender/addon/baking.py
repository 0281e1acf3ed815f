"""Bakes and previews as Blender sees them: a process of Balloon Warp, its messages, and the text on the panel."""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import bpy
from bpy.types import Context, Scene

from . import modifiers, properties
from .reading import read_scene
from .request import FILES, LIVE, RefusedError, Snapshot, tears_of, write_request

TOLD, ERRORS = "progress.jsonl", "errors.txt"
"""Files of a process's messages and of its standard error"""
STOP_SECONDS = 30.0
"""Time that a process has to save its results [s]"""
POLL_SECONDS = 0.2
"""Interval between looks at what a bake tells [s]"""
PICTURE_SECONDS = 1.0 / 24.0
"""Interval between pictures of a preview [s]"""
FLOAT = 4
"""Bytes of a number"""
MOST_POINTS = 3000
"""Points of all balloons that play live"""
PATHS = {"pressure": "inflation.pressure", "lift": "helium", "damping": "damping"}
"""Fields of a balloon that follow a property while it is dragged"""


class Worker:
    """A process that works on a request.

    Args:
        folder: of the request.
        options: of its command.

    Raises:
        OSError: the folder cannot be written.
        RefusedError: there is no such Python.
    """

    def __init__(self, folder: Path, *options: str):
        self.folder, self._read = folder, 0
        python = properties.python()
        environment = dict(os.environ, PYTHONUNBUFFERED="1")
        if not python:  # Blender's own, which finds what Blender finds
            environment["PYTHONPATH"] = os.pathsep.join(path for path in sys.path if path)
        command = [python or sys.executable, "-m", "balloon_warp.blender.bake", str(folder), *options]
        with (folder / TOLD).open("wb") as told, (folder / ERRORS).open("wb") as errors:
            pipes = {"stdin": subprocess.PIPE, "stdout": told, "stderr": errors}
            try:
                self.process = subprocess.Popen(command, env=environment, **pipes)
            except OSError as error:
                raise RefusedError(
                    f"{command[0]}: cannot be started: {error.strerror}; see Preferences, Python"
                ) from None

    @property
    def ended(self) -> bool:
        """Return whether the process has ended."""
        return self.process.poll() is not None

    def hear(self) -> list[dict[str, Any]]:
        """Return the lines that it has told since the last time."""
        heard = []
        with (self.folder / TOLD).open("rb") as told:
            told.seek(self._read)
            for line in told:
                if line.endswith(b"\n"):  # the rest comes next time
                    self._read += len(line)
                    heard.append(json.loads(line))
        return heard

    def tell(self, what: dict[str, Any]) -> None:
        """Tell the process a line, if it still listens."""
        with suppress(OSError):  # it has ended
            if self.process.stdin:
                self.process.stdin.write(json.dumps(what).encode() + b"\n")
                self.process.stdin.flush()

    def ask_to_end(self) -> None:
        """Close the input of the process, which then saves its frames and exits."""
        with suppress(OSError):
            if self.process.stdin:
                self.process.stdin.close()

    def stop(self) -> None:
        """End the process, and wait for that."""
        self.ask_to_end()
        try:
            self.process.wait(STOP_SECONDS)
        except subprocess.TimeoutExpired:
            self.process.kill()

    def last_error(self) -> str:
        """Return the last line that it wrote on its standard error."""
        lines = (self.folder / ERRORS).read_text(encoding="utf-8", errors="replace").split("\n")
        last = [line.strip() for line in lines if line.strip()][-1:]
        return last[0] if last else f"its process was killed ({self.process.returncode})"


class Bake(Worker):
    """A bake that runs.

    Args:
        scene: with the balloons.
        folder: with the request.
        resume: whether it goes on from a checkpoint.
        remarks: Sentences for the panel.
    """

    def __init__(self, scene: Scene, folder: Path, resume: bool, remarks: Sequence[str] = ()):
        super().__init__(folder, "--attached", *(["--resume"] if resume else []))
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
                modifiers.refresh(scene)
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
            modifiers.rest(each)  # which takes part no more
    for thing, file in zip(snapshot.things, files, strict=True):
        if file and (found := modifiers.player(scene, thing.name)):
            modifiers.play(found, folder / file, scene.frame_start)
            modifiers.remove_tears(found)
            if thing.bursts:
                modifiers.add_tears(found, len(thing.counts))
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
            modifiers.play(found, folder / each["file"], scene.frame_start)
            if not modifiers.find_tears(found) and (torn := tears_of(folder / each["file"])).exists():
                modifiers.add_tears(found, torn.stat().st_size // FLOAT)
    return begun


def begin(scene: Scene, folder: Path, resume: bool, remarks: Sequence[str] = ()) -> Bake:
    """Begin the process of a bake, or go on with one that was stopped.

    Raises:
        RefusedError: another bake runs.
    """
    global running
    require_none()
    running = Bake(scene, folder, resume, remarks)
    if not bpy.app.timers.is_registered(watch):
        bpy.app.timers.register(watch, first_interval=POLL_SECONDS)
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
    return POLL_SECONDS if running else None


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
        modifiers.rest(thing)
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


class Preview(Worker):
    """A preview that runs.

    Args:
        scene: with the balloons.
        folder: with the request.
        snapshot: that it was made of.
        files: Names of the caches of its things, empty for those without.
    """

    def __init__(self, scene: Scene, folder: Path, snapshot: Snapshot, files: list[str]):
        super().__init__(folder, "--preview")
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
                    modifiers.play(thing, path, scene.frame_start)
                    modifiers.show_tears(thing, torn=False)
        modifiers.refresh(scene)
        values = self._values(scene)
        if changed := {path: value for path, value in values.items() if self._told.get(path) != value}:
            self._told = values
            self.tell(changed)
        self._error = next((line["error"] for line in heard if "error" in line), self._error)
        if ended:
            say(scene, self._error or f"The preview ended: {self.last_error()}", is_error=True)
        return not ended

    def close(self) -> None:
        """End the preview; its objects play their caches of before."""
        self.stop()
        if scene := bpy.data.scenes.get(self.scene_name):
            for thing in scene.objects:
                path, found = modifiers.cache_of(thing), modifiers.find(thing)
                if path in self._before and found:
                    modifiers.restore(found, self._before[path])
                    modifiers.show_tears(thing, torn=True)
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


previewing: Preview | None = None
"""The preview that runs, of which there is one at a time"""


def start_preview(context: Context) -> None:
    """Begin a preview of the scene.

    Raises:
        RefusedError: something cannot be simulated, is too large, or a bake runs.
    """
    global previewing
    require_none()
    snapshot = read_scene(context)
    points = sum(len(thing.points) for thing in snapshot.things if thing.role == "BALLOON")
    if points > MOST_POINTS:
        raise RefusedError(f"{context.scene.name}: its balloons have {points} vertices; expected {MOST_POINTS} at most")
    for thing in snapshot.things:
        thing.settings["burst"] = "NEVER"  # who drags wants to see it whole
    folder = Path(bpy.app.tempdir) / "balloon_warp_preview"
    try:
        files = write_request(folder, snapshot)
        previewing = Preview(context.scene, folder, snapshot, files)
    except OSError as error:
        raise RefusedError(f"{folder}: cannot be written: {error.strerror}") from None
    bpy.app.timers.register(watch_preview, first_interval=PICTURE_SECONDS)


def watch_preview() -> float | None:
    """Follow the preview that runs, as a timer of Blender's."""
    if previewing and not previewing.poll():
        stop_preview()
    redraw()
    return PICTURE_SECONDS if previewing else None


def stop_preview() -> None:
    """End the preview that runs."""
    global previewing
    if previewing:
        ended, previewing = previewing, None
        ended.close()


def stop_all() -> None:
    """End a bake or a preview that runs."""
    stop_preview()
    stop()
