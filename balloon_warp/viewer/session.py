"""Thread that advances the simulation, and waits for nobody.

It grants requests between two frames, and leaves pictures where others can take them.
"""

import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import BlowUpError
from balloon_warp.kernels.laws import Law
from balloon_warp.scene import Scene
from balloon_warp.viewer.moments import Moments
from balloon_warp.viewer.pace import Pace
from balloon_warp.viewer.picture import Picture
from balloon_warp.viewer.playground import Playground
from balloon_warp.viewer.recording import Recording, free_number
from balloon_warp.viewer.saving import told_of_saving
from balloon_warp.viewer.touches import Kinds, Touch
from balloon_warp.viewer.trouble import sentence_of
from balloon_warp.viewer.wishes import Wish, Wishes
from balloon_warp.warp_lock import PROCESS_LOCK, lock_of

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
        self._wishes, self._stop = Wishes(self._refuse), threading.Event()
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
        self._wishes.came.set()
        if self._thread.is_alive():
            self._thread.join()
        self._end_recording()
        if self.writer:
            self.writer.join()

    def ask(self, wish: Wish, key: object = None, touch: Touch | None = Touch.SETS) -> None:
        """Queue a wish for the playground before the next frame; returns at once, from any thread.

        Args:
            key: The last of several waiting wishes with this key replaces the others.
            touch: What it does to the scene; None if nothing.
        """
        self._wishes.add(wish, key, touch)

    def kernels_came(self) -> None:
        """Look again whether waiting touches have their kernels."""
        self._wishes.came.set()

    @property
    def asked(self) -> int:
        """Number of wishes until now."""
        return self._wishes.asked

    @property
    def busy_seconds(self) -> float:
        """Time that the current request, or the frame, takes so far, or that a touch waits for kernels; else 0 [s]."""
        since = self._busy_since
        return max(time.perf_counter() - since if since else 0.0, self._wishes.waited_seconds)

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
            self._wishes.drop_touches()
            self._end_recording()
            playground.reset()
            self._begin_anew()

        self.ask(reset, key="reset", touch=None)

    def load(self, name: str, find: Callable[[], Scene]) -> None:
        """Ask for another scene. If it cannot be simulated, this one goes on."""

        def load(_: Playground) -> None:
            playground = Playground(find(), self.device, self.laws)
            self._wishes.drop_touches()
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
                self._revision += 1

        self.ask(go_back, touch=None)

    def record(self, on: bool) -> None:
        """Ask for a recording to begin, or to end and be written."""

        def begin(_: Playground) -> None:
            self.recording = self.recording or Recording()

        self.ask(begin if on else lambda _: self._end_recording(), key="record", touch=None)

    def _begin_anew(self) -> None:
        self.trouble, self.why, self.running, self._is_back = "", "", True, False
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
                self._wishes.fail(mistake)
                self._stop.wait(0.25)

    def _go_on(self) -> None:
        """Grant wishes, and simulate a frame, if time goes on."""
        with lock_of(self.playground.simulator.model.device):
            self._busy_since = time.perf_counter()
            self._wishes.grant(lambda: self.playground, self.is_ready)
            self._busy_since = None
        if not self.running or not self.watched:
            self.pace.rest()
            self._show()
            self._wishes.came.wait(0.25)
            self._wishes.came.clear()
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
        try:
            playground.step(self._tell_of_blow_up)
        except BlowUpError as failure:
            self.trouble, self.why, self.running = sentence_of(failure, playground.live), str(failure), False
            self._is_back = self._moments.go_back(playground)  # the last good shape stays to be seen
            return
        if self.recording:
            self.recording.add(playground.simulator.read_frame(), playground.numbers)
            if self.recording.full:
                self._end_recording()
        self._step_seconds += 0.1 * (time.perf_counter() - began - self._step_seconds)

    def _tell_of_blow_up(self) -> None:
        """Show that time stands still, with the last good shape, while the reason is looked for."""
        self.picture = replace(self.picture, running=False, trouble=LOOKING)

    def _end_recording(self) -> None:
        """Write the recording, beside the simulation: it takes longer than a frame."""
        if not self.recording:
            return
        recorded, self.recording = self.recording.end(self.playground.journal), None
        self._recordings = free_number(self.folder, self.name, self._recordings + 1)
        name = f"{self.name}_{self._recordings}"

        def write() -> None:
            said, files = told_of_saving(recorded, self.folder, name, self.laws)
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
            granted=self._wishes.granted,
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
