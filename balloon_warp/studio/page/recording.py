"""Recording of a session, in a process of its own: a stage, a picture, and the scene that replays it."""

import os
import pickle
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from balloon_warp.errors import InputError
from balloon_warp.frame import Frame
from balloon_warp.kernels.laws import Law
from balloon_warp.model import Model, build_model
from balloon_warp.run.provenance import describe_simulation, without_folders
from balloon_warp.scene import Scene
from balloon_warp.scene.write import scene_toml
from balloon_warp.studio.page.playground import Journal
from balloon_warp.system.files import check_writable, marked_scene, whole_file
from balloon_warp.system.streams import open_closed_streams
from balloon_warp.system.warp_setup import quiet_warp
from balloon_warp.usd import StageWriter


@dataclass(frozen=True)
class Picture:
    """Snapshot of a session at one time."""

    load: int
    """Number of scenes loaded until now: another number, another model"""
    revision: int
    """Number that changes whenever values of the scene changed otherwise than by being set"""
    executed: int
    """Number of commands whose effect it shows"""
    name: str
    model: Model
    scene: Scene
    frame: Frame
    seconds: float
    sphere_numbers: tuple[int, ...]
    """Numbers of the spheres that exist, over the whole simulation"""
    hands: frozenset[int]
    """Strings that are a user's hands"""
    inflation: float
    running: bool
    speed: float
    rate: float
    """Simulated seconds over the wall's"""
    step_seconds: float
    """Wall-clock time for a frame [s]"""
    schedule: str
    trouble: str
    """Blow-up or failure, in a sentence; empty without one"""
    why: str
    """Further explanation, where more is known"""
    recorded_seconds: float | None
    """Length of the recording in progress [s]"""


MOST_BYTES = 1 << 29
"""Largest memory of frames that wait to be written [bytes]; a recording that gets there ends"""


@dataclass(frozen=True)
class Recorded:
    """A recording that ended."""

    frames: list[Frame]
    journal: Journal
    bodies: list[tuple[list[int], list[int]]]
    """Spheres and strings in each frame, by their numbers in the journal"""


class Recording:
    """Collects frames."""

    def __init__(self) -> None:
        self.frames: list[Frame] = []
        self.bodies: list[tuple[list[int], list[int]]] = []
        self.bytes = 0

    @property
    def full(self) -> bool:
        return self.bytes > MOST_BYTES

    def add(self, frame: Frame, bodies: tuple[list[int], list[int]]) -> None:
        """Add a frame; one that was recorded already, and undone since, is replaced, and so are those after it."""
        while self.frames and self.frames[-1].number >= frame.number:
            self.frames.pop()
            self.bodies.pop()
        self.frames.append(frame)
        self.bodies.append((list(bodies[0]), list(bodies[1])))
        self.bytes += 3 * sum(points.nbytes for points in frame.points)

    def end(self, journal: Journal) -> Recorded:
        """End the recording, and return it."""
        return Recorded(self.frames, journal.copy(), self.bodies)


def write_recording(recorded: Recorded, folder: Path, name: str, laws: Sequence[Law] = ()) -> list[Path]:
    """Write NAME.usdc, whose first frame is 0, and NAME.toml, which replays it from its start; returns the files.

    Raises:
        InputError: nothing was recorded, a file cannot be written, or too much was done to be replayed.
    """
    if not recorded.frames:
        raise InputError("nothing was recorded: no time has passed")
    stage, script = folder / f"{name}.usdc", folder / f"{name}.toml"
    for path in (stage, script):
        check_writable(path, (path.suffix,))
    scene = recorded.journal.scene(recorded.frames[-1].number)
    model = build_model(scene, "cpu", laws=laws)
    first = recorded.frames[0].number
    described = {**without_folders(describe_simulation(scene, laws, model.substeps)), "firstFrame": first}
    with StageWriter(stage, model, described) as writer:
        for frame, bodies in zip(recorded.frames, recorded.bodies, strict=True):
            writer.write(replace(_with_all_bodies(frame, bodies, model), number=frame.number - first))
    with whole_file(script) as temporary:
        temporary.write_text(marked_scene(scene_toml(scene, folder)), encoding="utf-8")
    return [stage, script]


def free_number(folder: Path, name: str, number: int) -> int:
    """Return the first number from one on for which there is no file NAME_NUMBER yet."""
    while any((folder / f"{name}_{number}{suffix}").exists() for suffix in (".usdc", ".toml")):
        number += 1
    return number


def _with_all_bodies(frame: Frame, bodies: tuple[list[int], list[int]], model: Model) -> Frame:
    """Return the frame with all spheres and strings of the journal; absent ones rest where they start."""
    positions = model.parameters["initial_sphere_positions"].numpy()[0].reshape(-1, 3).copy()
    velocities = np.zeros_like(positions)
    anchors = model.parameters["string_anchor"].numpy()[0].reshape(-1, 3).copy()
    positions[bodies[0]] = frame.sphere_positions[: len(bodies[0])]
    velocities[bodies[0]] = frame.sphere_velocities[: len(bodies[0])]
    lengths = model.parameters["string_length"].numpy()[0].copy()
    anchors[bodies[1]] = frame.string_anchors[: len(bodies[1])]
    lengths[bodies[1]] = frame.string_lengths[: len(bodies[1])]
    balls = {"sphere_positions": positions, "sphere_velocities": velocities}
    return replace(frame, **balls, string_anchors=anchors, string_lengths=lengths)


NICENESS = 10
"""Niceness of the process: the simulation comes first"""


class Done(str):
    """A notice of success."""


def save_recording(recorded: Recorded, folder: Path, name: str, laws: Sequence[Law] = ()) -> list[Path]:
    """Write a recording as `write_recording` in another process.

    Laws that only this process knows keep it here.

    Raises:
        InputError: nothing was recorded, a file cannot be written, or too much was done to be replayed.
    """
    try:
        others = pickle.dumps((recorded.journal, recorded.bodies, folder, name, tuple(laws)))
    except (pickle.PicklingError, AttributeError, TypeError):
        return write_recording(recorded, folder, name, laws)
    if any(law.force.func.__module__ == "__main__" for law in laws):
        return write_recording(recorded, folder, name, laws)
    found = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    command = [sys.executable, "-m", __name__]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=found) as process:
        assert process.stdin
        assert process.stdout
        try:
            process.stdin.write(others)
            for frame in recorded.frames:  # one by one: each holds Python's lock for a moment only
                pickle.dump(frame, process.stdin)
            process.stdin.close()
            answer = pickle.load(process.stdout)
        except (BrokenPipeError, EOFError, pickle.UnpicklingError):
            raise InputError(f"{name}: the process that writes it died") from None
    if isinstance(answer, InputError):
        raise answer
    return answer


def saving_outcome(
    recorded: Recorded, folder: Path, name: str, laws: Sequence[Law] = ()
) -> tuple[str, tuple[Path, ...]]:
    """Save a recording, and return the outcome in a sentence, and the files."""
    try:
        files = save_recording(recorded, folder, name, laws)
    except InputError as mistake:
        return str(mistake), ()
    return Done(f"wrote {' and '.join(file.name for file in files)} in {folder}"), tuple(files)


def main() -> None:
    """Read a recording from standard input, write it, and tell the files, or the error, on standard output."""
    open_closed_streams()
    answers = os.dup(1)
    os.dup2(2, 1)  # a library's output is no answer
    if hasattr(os, "nice"):
        os.nice(NICENESS)
    quiet_warp()
    source = sys.stdin.buffer
    journal, bodies, folder, name, laws = pickle.load(source)
    recorded = Recorded([pickle.load(source) for _ in bodies], journal, bodies)
    try:
        answer: object = write_recording(recorded, folder, name, laws)
    except InputError as mistake:
        answer = InputError(str(mistake))
    with os.fdopen(answers, "wb") as out:
        pickle.dump(answer, out)


if __name__ == "__main__":
    main()
