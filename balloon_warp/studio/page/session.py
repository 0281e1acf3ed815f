"""A session: the thread that advances the simulation, the command queue of other threads, and its recording.

The thread grants requests between two frames, and leaves pictures where others can take them. A touch whose kernels are
still being compiled waits for them; time and the other commands do not wait for it.
"""

import os
import pickle
import subprocess
import sys
import threading
import time
import traceback
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from balloon_warp.blow_ups import BlowUp
from balloon_warp.errors import InputError
from balloon_warp.frame import Frame
from balloon_warp.kernels.laws import Law
from balloon_warp.model import Model, build_model
from balloon_warp.run.report import describe_simulation, without_folders
from balloon_warp.scene import Scene
from balloon_warp.scene.load import scene_toml
from balloon_warp.studio.page.playground import REASON, Journal, Kinds, Moments, Playground, Touch, kinds_of
from balloon_warp.system.files import check_writable, marked_scene, whole_file
from balloon_warp.system.process import open_closed_streams
from balloon_warp.system.warp_setup import quiet_warp
from balloon_warp.system.warp_threads import PROCESS_LOCK, lock_of
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
    command = [sys.executable, "-c", f"from {__name__} import write_from_pipe; write_from_pipe()"]
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


def write_from_pipe() -> None:
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


MOST_ASKED = 1000
"""Largest number of queued commands; more are ignored"""
GRANTING_SECONDS = 0.1
"""Time that commands may take before a frame is simulated again [s]"""
Command = Callable[[Playground], None]


@dataclass(frozen=True)
class _Pending:
    """Queued command."""

    command: Command
    touch: Touch | None
    number: int
    """Number of commands until it, and with it"""
    since: float


class CommandQueue:
    """Command queue: first come, first served.

    Args:
        refused: called with a sentence, where a command fails.
    """

    def __init__(self, refused: Callable[[str], None]):
        self.came = threading.Event()
        """Event that is set when there are commands"""
        self.asked, self.executed = 0, 0
        """Number of commands so far, and number of those executed"""
        self._refused = refused
        self._waiting: dict[object, _Pending] = {}
        self._lock = threading.Lock()
        self._failures: set[type[Exception]] = set()
        """Failures that the terminal was told about"""

    def add(self, command: Command, key: object = None, touch: Touch | None = None) -> None:
        """Add a command; of several queued with the same key, only the last is executed. From any thread.

        Args:
            touch: what it does to the scene; nothing that needs other kernels, when missing.
        """
        with self._lock:
            if len(self._waiting) < MOST_ASKED:
                key = key if key is not None else object()
                self._waiting.pop(key, None)
                self.asked += 1
                self._waiting[key] = _Pending(command, touch, self.asked, time.perf_counter())
        self.came.set()

    def drop_touches(self) -> None:
        """Drop the commands that wait for kernels: the scene is another one."""
        with self._lock:
            self._waiting = {key: each for key, each in self._waiting.items() if each.touch is None}

    @property
    def waited_seconds(self) -> float:
        """Age of the oldest queued command [s]; 0 without one."""
        with self._lock:
            since = [each.since for each in self._waiting.values()]
        return time.perf_counter() - min(since) if since else 0.0

    def execute(self, playground: Callable[[], Playground], is_ready: Callable[[Kinds], bool]) -> bool:
        """Execute the queued commands; where there are many, the rest waits for the next frame.

        Args:
            playground: Current playground; a command may bring another.
            is_ready: whether there are kernels for such things.

        Returns:
            Whether anything was asked for.
        """
        until, any_came = time.perf_counter() + GRANTING_SECONDS, False
        while command := self._next(playground(), is_ready):
            any_came = True
            self._execute(command, playground())
            if time.perf_counter() > until:
                self.came.set()
                break
        return any_came

    def _next(self, playground: Playground, is_ready: Callable[[Kinds], bool]) -> Command | None:
        waits = set()
        """Lines in which somebody waits"""
        with self._lock:
            for key, each in self._waiting.items():
                if each.touch and (each.touch.line in waits or not is_ready(each.touch.leaves(playground.live))):
                    waits.add(each.touch.line)
                    continue
                return self._waiting.pop(key).command
            self.executed = min((each.number for each in self._waiting.values()), default=self.asked + 1) - 1
            return None

    def _execute(self, command: Command, playground: Playground) -> None:
        try:
            command(playground)
        except (InputError, ValueError, TypeError, IndexError, OverflowError) as mistake:
            self._refused(str(mistake).partition("\n")[0])
        except Exception as mistake:  # one of ours must not end the page that others watch
            self.fail(mistake)
            self._refused("this failed; the terminal has the error")

    def fail(self, mistake: Exception) -> None:
        """Report an unexpected failure on the terminal; once of each kind, so that it does not fill it."""
        if type(mistake) not in self._failures:
            self._failures.add(type(mistake))
            traceback.print_exception(mistake)


MOST_BEHIND = 0.25
"""Largest lag of the simulation that it can catch up [s]; beyond it, time runs slower instead"""
WINDOW = 1.0
"""Window over which the rate is averaged [s]"""


class Pace:
    """Pace of simulated time: when each frame is due, and how fast time really runs.

    Args:
        speed: Simulated seconds a second of the wall's clock.
    """

    def __init__(self, speed: float = 1.0):
        self.speed = speed
        self._due: float | None = None
        self._passed: deque[tuple[float, float]] = deque()
        """Times at which frames were done, and simulated time of each [s]"""

    def rest(self) -> None:
        """Stop time until the next frame."""
        self._due = None
        self._passed.clear()

    def wait(self, now: float, frame_seconds: float) -> float:
        """Return the seconds until the next frame is due; counts on it being simulated then."""
        if self._due is None or now > self._due + MOST_BEHIND:
            self._due = now
        wait = max(self._due - now, 0.0)
        self._due += frame_seconds / self.speed
        return wait

    def passed(self, now: float, frame_seconds: float) -> None:
        """Record that a frame is done."""
        self._passed.append((now, frame_seconds))
        while now - self._passed[0][0] > WINDOW:
            self._passed.popleft()

    @property
    def rate(self) -> float:
        """Simulated seconds over the wall's, lately; 0 until there are two frames."""
        if len(self._passed) < 2:
            return 0.0
        simulated = sum(seconds for _, seconds in list(self._passed)[1:])
        return simulated / max(self._passed[-1][0] - self._passed[0][0], 1e-9)


def sentence_of(report: BlowUp, scene: Scene) -> str:
    """Return the cause of a blow-up, as in "Too much pressure for these springs."."""
    skin = "this skin" if any(balloon.material.is_membrane for balloon in scene.balloon) else "these springs"
    inflated = report.other is None or report.other.by == "inflation"  # else something pulled harder than its springs
    if report.is_sphere:
        return "Too hard a blow for this sphere."
    if report.pressure or report.limit_point or (inflated and _step_is_stable(report)):
        return f"Too much pressure for {skin}."
    return f"Too {'much force' if _step_is_stable(report) else 'few substeps'} for {skin}."


def _step_is_stable(report: BlowUp) -> bool:
    return report.stable_step is not None and 0.0 < report.step <= report.stable_step


LOOKING = "It blew up. Looking for the reason."
SHOWN_SECONDS = 1.0 / 30.0
"""Time between two pictures of the state [s]"""


@dataclass
class Session:
    """Simulation that is played with.

    Args:
        name: of the scene.
        scene: where it starts.
        device: Warp device; the GPU, or else the CPU, if not given.
        folder: Folder of recordings.
        laws: User-defined laws beside the built-in ones; see `balloon_warp.laws`.

    Raises:
        InputError: the scene cannot be simulated.
    """

    name: str
    scene: Scene
    device: str | None = None
    folder: Path = Path()
    laws: Sequence[Law] = ()
    notices: deque[str] = field(default_factory=lambda: deque(maxlen=20))
    """Notices for the viewer, oldest first"""
    watched: bool = False
    """Whether anybody looks; time stands still while nobody does"""
    wants_forces: bool = False
    """Whether net forces are shown"""
    is_ready: Callable[[Kinds], bool] = lambda kinds: True
    """Tells whether there are kernels for such things: touches that bring them wait until then"""
    prepare: Callable[[Scene], None] = lambda scene: None
    """Begins to make the kernels of another scene"""

    def __post_init__(self) -> None:
        with PROCESS_LOCK:
            self.playground = Playground(self.scene, self.device, self.laws)
        self.pace = Pace()
        self.running, self.trouble, self.why = True, "", ""
        self._is_back = False
        """Whether the state is good again, after trouble"""
        self._unexplained: tuple[Callable[[], BlowUp], Scene] | None = None
        """What finds the reason of the last blow-up, until it is known, and the scene then"""
        self.recording: Recording | None = None
        self.writer: threading.Thread | None = None
        """Thread that writes the last recording"""
        self.saved: tuple[Path, ...] = ()
        """Files of the last recording that was written"""
        self._load, self._revision, self._step_seconds = 1, 1, 0.0
        self._busy_since: float | None = None
        self._moments = Moments()
        self._recordings = 0
        self._methods: dict[str, object] = {}
        """Methods that were asked for since the start"""
        self._commands, self._stop = CommandQueue(self._refuse), threading.Event()
        self._shown_at = 0.0
        self._show()
        self._thread = threading.Thread(target=self._run, name="simulation", daemon=True)

    def begin_at(self, state: Mapping[str, NDArray]) -> None:
        """Start from a state, as `Simulator.restore` takes it; a reset goes to the scene's start."""
        self.playground.simulator.restore(state)
        self._show()

    def start(self) -> None:
        """Begin to simulate."""
        self._thread.start()

    def stop(self) -> None:
        """End, once the frame that is being simulated is done; a recording that goes on is saved."""
        self._stop.set()
        self._commands.came.set()
        if self._thread.is_alive():
            self._thread.join()
        self._end_recording()
        if self.writer:
            self.writer.join()

    def ask(self, command: Command, key: object = None, touch: Touch | None = Touch.SETS) -> None:
        """Queue a command for the playground before the next frame; returns at once, from any thread.

        Args:
            key: The last of several queued commands with this key replaces the others.
            touch: What it does to the scene; None if nothing.
        """
        self._commands.add(command, key, touch)

    def kernels_came(self) -> None:
        """Look again whether waiting touches have their kernels."""
        self._commands.came.set()

    @property
    def asked(self) -> int:
        """Number of commands until now."""
        return self._commands.asked

    @property
    def busy_seconds(self) -> float:
        """Time that the current request, or the frame, takes so far, or that a touch waits for kernels; else 0 [s]."""
        since = self._busy_since
        return max(time.perf_counter() - since if since else 0.0, self._commands.waited_seconds)

    def set(self, path: str, value: object) -> None:
        """Ask for a value of the scene to change."""
        self.ask(lambda playground: playground.set(path, value), key=path)

    def set_method(self, field: str, value: object) -> None:
        """Ask for another method, such as another solver, once its kernels are there."""
        self._methods[field] = value
        self.prepare(self.playground.start.model_copy(update=self._methods))
        self.set(field, value)

    def run(self, running: bool) -> None:
        """Ask for time to go on, or to stand still."""

        def switch(_: Playground) -> None:
            self.running = running and not self.trouble

        self.ask(switch, key="run", touch=None)

    def step_once(self) -> None:
        """Ask for time to stand still after one more frame."""

        def step(_: Playground) -> None:
            self.running = False
            if not self.trouble:
                self._advance()

        self.ask(step, touch=None)

    def set_speed(self, speed: float) -> None:
        """Ask for simulated seconds a second of the wall's clock."""

        def change(_: Playground) -> None:
            self.pace.speed = float(np.clip(float(speed), 0.01, 100.0))
            self.pace.rest()

        self.ask(change, key="speed", touch=None)

    def reset(self) -> None:
        """Ask for the start of the scene."""

        def reset(playground: Playground) -> None:
            self._commands.drop_touches()
            self._end_recording()
            playground.reset()
            self._begin_anew()

        self.ask(reset, key="reset", touch=None)

    def load(self, name: str, find: Callable[[], Scene]) -> None:
        """Ask for another scene. If it cannot be simulated, this one goes on."""

        def load(_: Playground) -> None:
            playground = Playground(find(), self.device, self.laws)
            self._commands.drop_touches()
            self._end_recording()
            self.name, self.playground = name, playground
            self._load += 1
            self._begin_anew()

        self.ask(load, key="load", touch=None)

    def go_back(self) -> None:
        """Ask for the last good state, and again for the one before; time then stands still there."""

        def go_back(_: Playground) -> None:
            if self._is_back or self._moments.go_back(self.playground):
                self.trouble, self.why, self.running, self._is_back = "", "", False, False
                self._unexplained = None
                self._revision += 1

        self.ask(go_back, touch=None)

    def record(self, on: bool) -> None:
        """Ask for a recording to begin, or to end and be written."""

        def begin(_: Playground) -> None:
            self.recording = self.recording or Recording()

        self.ask(begin if on else lambda _: self._end_recording(), key="record", touch=None)

    def _begin_anew(self) -> None:
        self.trouble, self.why, self.running, self._is_back = "", "", True, False
        self._unexplained = None
        self._moments.clear()
        self._methods.clear()
        self._revision += 1
        self.pace.rest()

    def _run(self) -> None:
        while not self._stop.is_set():
            try:
                self._go_on()
            except Exception as mistake:  # one of ours must not leave a page that stands still without a word
                self.trouble = "The simulation failed; the terminal has the error. Reset restarts it."
                self.running, self.why, self._is_back = False, "", False
                self._commands.fail(mistake)
                self._stop.wait(0.25)

    def _go_on(self) -> None:
        """Execute commands, and simulate a frame, if time goes on."""
        with lock_of(self.playground.simulator.model.device):
            self._busy_since = time.perf_counter()
            self._commands.execute(lambda: self.playground, self.is_ready)
            self._busy_since = None
        if not self.running or not self.watched:
            self.pace.rest()
            self._show()
            if self._explain():
                return
            self._commands.came.wait(0.25)
            self._commands.came.clear()
            return
        frame_seconds = self.playground.simulator.model.frame_seconds
        time.sleep(self.pace.wait(time.perf_counter(), frame_seconds))
        with lock_of(self.playground.simulator.model.device):
            self._busy_since = time.perf_counter()
            self._advance()
            self._busy_since = None
        now = time.perf_counter()
        self.pace.passed(now, frame_seconds)
        if now - self._shown_at >= SHOWN_SECONDS:
            self._shown_at = now
            self._show()

    def _show(self) -> None:
        with lock_of(self.playground.simulator.model.device):
            self.picture = self._take_picture()

    def tell(self, sentence: str) -> None:
        """Send a sentence to the viewer."""
        self.notices.append(sentence)

    def _refuse(self, sentence: str) -> None:
        self.notices.append(sentence)
        self._revision += 1  # whoever asked sees the present values

    def _advance(self) -> None:
        """Simulate one frame."""
        playground, began = self.playground, time.perf_counter()
        self._moments.note(playground)
        if find_reason := playground.step():
            self.trouble, self.why, self.running = LOOKING, "", False
            self._unexplained = find_reason, playground.live
            self._is_back = self._moments.go_back(playground)  # the last good shape stays to be seen
            return
        if self.recording:
            self.recording.add(playground.simulator.read_frame(), playground.numbers)
            if self.recording.full:
                self._end_recording()
        self._step_seconds += 0.1 * (time.perf_counter() - began - self._step_seconds)

    def _explain(self) -> bool:
        """Find the reason of the last blow-up, once there are its kernels; return whether it was found."""
        if not self._unexplained or not self.is_ready(kinds_of(self._unexplained[1]) | REASON):
            return False
        (find_reason, scene), self._unexplained = self._unexplained, None
        self._busy_since = time.perf_counter()
        report = find_reason()
        self._busy_since = None
        self.trouble, self.why = sentence_of(report, scene), str(report)
        return True

    def _end_recording(self) -> None:
        """Write the recording, beside the simulation: it takes longer than a frame."""
        if not self.recording:
            return
        recorded, self.recording = self.recording.end(self.playground.journal), None
        self._recordings = free_number(self.folder, self.name, self._recordings + 1)
        name = f"{self.name}_{self._recordings}"

        def write() -> None:
            said, files = saving_outcome(recorded, self.folder, name, self.laws)
            self.saved = files or self.saved
            self.tell(said)

        self.writer = threading.Thread(target=write, name="recording")
        self.writer.start()

    def _take_picture(self) -> Picture:
        playground = self.playground
        simulator = playground.simulator
        began = self.recording.frames[0].number if self.recording and self.recording.frames else playground.frame
        return Picture(
            load=self._load,
            revision=self._revision,
            executed=self._commands.executed,
            name=self.name,
            model=simulator.model,
            scene=playground.live,
            frame=simulator.read_frame(net_forces=self.wants_forces),
            seconds=playground.seconds,
            sphere_numbers=tuple(playground.numbers[0]),
            hands=frozenset(playground.hands.values()),
            inflation=playground.inflation,
            running=self.running,
            speed=self.pace.speed,
            rate=self.pace.rate,
            step_seconds=self._step_seconds,
            schedule=simulator.schedule.name,
            trouble=self.trouble,
            why=self.why,
            recorded_seconds=(playground.frame - began) * simulator.model.frame_seconds if self.recording else None,
        )
