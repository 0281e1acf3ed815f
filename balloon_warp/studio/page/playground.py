"""A simulation that is played with: every touch takes effect between two frames; kernels of touches compiled ahead.

Kernels of touches are compiled in a process of its own: a thread would hold Python's lock. It reports which are done,
one kind of scene after the other. Until then a command that needs them waits, and time goes on.
"""

import contextlib
import functools
import hashlib
import json
import os
import pickle
import shutil
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from pathlib import Path
from typing import Any, Literal, TextIO

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.blow_ups import BlowUp
from balloon_warp.errors import InputError
from balloon_warp.kernels.laws import Law
from balloon_warp.kernels.laws.membrane import SHEAR_MODULUS
from balloon_warp.model import lay_out, plan_model
from balloon_warp.model.plan import ModelPlan
from balloon_warp.model.pressure import with_resolved_pressure
from balloon_warp.model.setting import plan_setting
from balloon_warp.run.report import describe_simulation
from balloon_warp.scene import Balloon, Change, Inflation, Material, Scene, Sphere, Stiffness, String
from balloon_warp.scene.balloon import BLOWN
from balloon_warp.scene.load import frame_at, is_there, override_scene, scenes_over_time
from balloon_warp.schedules.touch_table import without_small_spheres
from balloon_warp.simulator import Simulator
from balloon_warp.system.warp_setup import quiet_warp
from balloon_warp.system.warp_threads import pick_device

Kinds = frozenset[str]
"""Kinds of things that have kernels of their own and that a hand may bring: spheres, strings and wind"""
REASON: Kinds = frozenset({"reason"})
"""Kind, beside those of a scene, of the kernels that find the reason of its blow-up"""


class Touch(Enum):
    """Ways to touch a scene; each has the kind of things that it brings or takes, and whether it brings them."""

    SETS = "", True
    THROWS = "sphere", True
    TIES = "string", True
    RELEASES = "string", False
    CUTS = "strings", False
    BLOWS = "wind", True

    @property
    def line(self) -> str:
        """Line in which touches wait for each other: a hand lets go after it took hold."""
        return self.value[0].rstrip("s")

    def leaves(self, scene: Scene) -> Kinds:
        """Return the kinds of things in a scene after this touch."""
        there, (kind, brings) = kinds_of(scene), self.value
        if brings:
            return there | {kind} if kind else there
        return there if kind == "string" and len(scene.string) > 1 else there - {"string"}


def kinds_of(scene: Scene) -> Kinds:
    """Return the kinds of things in a scene that a hand may bring."""
    there = {"sphere": scene.sphere, "string": scene.string, "wind": any(scene.atmosphere.wind)}
    return frozenset(kind for kind, some in there.items() if some)


def as_vector(place: NDArray) -> tuple[float, float, float]:
    """Return a place or velocity as scenes have it."""
    x, y, z = (float(value) for value in place)
    return x, y, z


MATERIALS = ("springs", "latex", "foil", "nylon")
"""Materials in the page's menu"""
FILMS = {"foil": 5.0, "nylon": 3.0}
"""Films, simulated as springs of a multiple of the stiffness, which bend freely: where no pressure is planned, real
film takes thousands of substeps a frame"""
FILM_STRETCH = 0.05
"""Stretch of an inflated film's skin"""


def material_of(scene: Scene) -> str:
    """Return the name of the first balloon's material."""
    balloon = scene.balloon[0]
    return balloon.material.preset or (balloon.look == "foil" and "foil") or balloon.material.law


def made_of(scene: Scene, name: str) -> Scene:
    """Return the scene with all balloons of another material.

    A gas stays; other inflations become the usual pressure of that material: a pressure that springs bear is too low
    for foil.

    Raises:
        InputError: it cannot be simulated so.
    """
    if name == material_of(scene):
        return scene
    said = {field: getattr(scene, field) for field in scene.model_fields_set}
    return Scene.model_validate(said | {"balloon": [_made_of(each, name) for each in scene.balloon], "change": []})


def _made_of(balloon: Balloon, name: str) -> Balloon:
    kept = {field: getattr(balloon, field) for field in balloon.model_fields_set - {"material", "look"}}
    if balloon.inflation.kind != "gas":
        kept["inflation"] = Inflation(stretch=FILM_STRETCH) if name in FILMS else Inflation()
    if name == "latex":
        for field in ("mass", "stiffness"):  # follow from its thickness
            kept.pop(field, None)
        return Balloon(**kept, material=Material(preset="latex"))
    if name in FILMS:
        kept["stiffness"] = _stiffer(balloon.stiffness, FILMS[name])
        kept["look"] = "foil"
    return Balloon(**kept)


def _stiffer(stiffness: Stiffness, factor: float) -> Stiffness:
    springs = {"structural": factor * stiffness.structural, "shear": factor * stiffness.shear, "flexion": 0.0}
    return stiffness.model_copy(update=springs)


def painted(scene: Scene, color: tuple[float, float, float]) -> Scene:
    """Return the scene with all balloons of a color, in linear RGB."""
    balloons = [balloon.model_copy(update={"color": color}) for balloon in scene.balloon]
    return scene.model_copy(update={"balloon": balloons})


SPHERE_DRAG = 0.47


def inflating(scene: Scene, value: float) -> list[tuple[str, Any]]:
    """Return paths and values for the keyframed field of all balloons that are inflated as the first one is.

    The scene's own filling ends.

    Raises:
        InputError: a balloon has a pump's curve, which holds for all time.
    """
    kind, changes = scene.balloon[0].inflation.kind, []
    for number, balloon in enumerate(scene.balloon):
        if balloon.inflation.kind == kind:
            given = f"balloon.{number}.inflation"
            changes += [(f"{given}.{field}", 0.0) for field in BLOWN if getattr(balloon.inflation, field)]
            changes.append((f"{given}.{balloon.inflation.keyframed}", value))
    override_scene(scene, changes)  # all of it or nothing
    return changes


def blowing(scene: Scene, wind: list[float]) -> list[tuple[str, Any]]:
    """Return paths and values for a wind [m/s].

    Balloons without any drag in air get a sphere's, or they would not feel it.
    """
    slippery = [number for number, balloon in enumerate(scene.balloon) if balloon.drag_coefficient == 0.0]
    drag = [(f"balloon.{number}.drag_coefficient", SPHERE_DRAG) for number in slippery]
    return [*drag, ("atmosphere.wind", wind)]


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


@dataclass(frozen=True)
class Moment:
    """Moment of a simulation, complete enough to go on from."""

    frame: int
    scene: Scene
    journal: Journal
    numbers: tuple[list[int], list[int]]
    substeps: int
    hands: dict[object, int]
    state: dict[str, NDArray]

    @property
    def extent(self) -> float:
        """Extent of all balloons together [m]."""
        return float(np.ptp(self.state["points"][0], axis=0).max())


MOST_SUBSTEPS = 1000
"""Largest number of substeps in a frame of the page"""
MOST_THROWN = 8
"""Largest number of thrown spheres at one time; the next one replaces the oldest"""


class Playground:
    """World on a device, to play with.

    Args:
        scene: where it starts.
        device: Warp device; the GPU, or else the CPU, if not given.
        laws: User-defined laws beside the built-in ones; see `balloon_warp.laws`.

    Raises:
        InputError: the scene cannot be simulated.
    """

    def __init__(self, scene: Scene, device: str | None = None, laws: Sequence[Law] = ()):
        self._least_substeps = 1 if scene.substeps == "auto" else scene.substeps
        plan = plan_model(scene, laws=laws)
        self._first_model = without_small_spheres(lay_out(plan, pick_device(device)))
        # settled, so that it stays, whatever else is changed
        self.start = with_resolved_pressure(self._first_model.scene, plan.parameters)
        self.keep_stable = True
        """Whether every change takes as many substeps as it needs"""
        self.size = float(max(np.ptp(shape.mesh.points, axis=0).max() for shape in self._first_model.shapes))
        """Size of the largest balloon at the start [m]"""
        self.reset()

    def reset(self) -> None:
        """Go back to the start of the scene, as it was given."""
        self.simulator = Simulator.of_model(self._first_model)
        self.live = self.start
        """Scene as it is now, but for its planned changes; once anything is touched, exactly as it is"""
        self.journal = Journal(self.start.model_copy(update={"substeps": self.simulator.model.substeps}))
        self.numbers = list(range(len(self.live.sphere))), list(range(len(self.live.string)))
        """Numbers of the current spheres and strings in the journal"""
        self._untouched = True
        self.hands: dict[object, int] = {}
        """String in the live scene that is a hand, by who holds it"""

    @property
    def frame(self) -> int:
        return self.simulator.frame_number

    @property
    def seconds(self) -> float:
        """Simulated time since the start [s]."""
        return self.frame * self.simulator.model.frame_seconds

    @property
    def inflation(self) -> float:
        """Current keyframed value of the first balloon."""
        times, values = np.array(self.live.balloon[0].inflation.keyframes).T
        return float(np.interp(self.seconds, times, values))

    def step(self) -> Callable[[], BlowUp] | None:
        """Simulate one frame; after a blow-up, return a function that diagnoses it (`Simulator.step_unexplained`)."""
        return self.simulator.step_unexplained()

    def set(self, path: str, value: Any) -> None:
        """Change a value of the scene.

        Raises:
            InputError: there is no such value, or it is out of its bounds; nothing changes then.
        """
        self._set([(path, value)])

    def inflate(self, value: float) -> None:
        """Change the keyframed values of all balloons of the first one's kind of inflation."""
        self._set(inflating(self.live, value))

    def blow(self, wind: list[float]) -> None:
        """Set the wind [m/s]; balloons without any drag in air get a sphere's, or they would not feel it."""
        self._set(blowing(self.live, wind))

    def paint(self, color: tuple[float, float, float]) -> None:
        """Give all balloons a color, in linear RGB, as if they had had it from the start."""
        self.start, self.live = painted(self.start, color), painted(self.live, color)
        self.journal.base = painted(self.journal.base, color)

    def throw(self, position: NDArray, velocity: NDArray, radius: float, mass: float) -> None:
        """Throw a sphere.

        Raises:
            InputError: it is too small, too heavy, or somewhere that cannot be.
        """
        sphere = Sphere(position=as_vector(position), velocity=as_vector(velocity), radius=radius, mass=mass)
        self._take_over()
        spheres, kept = [*self.live.sphere, sphere], list(range(len(self.live.sphere)))
        numbers = self.numbers[0]
        thrown = [number for number in kept if numbers[number] >= len(self.start.sphere)]
        if len(thrown) >= MOST_THROWN:
            oldest = thrown[0]
            self.journal.end(self.journal.spheres, numbers.pop(oldest), self.frame)
            del spheres[oldest], kept[oldest]
        numbers.append(self.journal.add_sphere(self.frame, sphere))
        self._rebuild(self.live.model_copy(update={"sphere": spheres}), [*kept, None])

    def tie(self, particle: int, anchor: NDArray, length: float | None = None, knot: bool = True) -> int:
        """Tie a string from a place to a particle, numbered over all balloons; returns its number in the live scene.

        It is taut, and as strong as the balloon is heavy; shorter where a length is given [m].

        Raises:
            InputError: it would be somewhere that cannot be.
        """
        offsets = self.simulator.model.particle_offsets
        balloon = int(np.searchsorted(offsets, particle, side="right")) - 1
        weight = float(self.simulator.model.parameters["mass"].numpy()[0, balloon])
        string = String(
            anchor=as_vector(anchor),
            balloon=balloon,
            particle=particle - offsets[balloon],
            length=length or max(float(np.linalg.norm(self.points[particle] - anchor)), 1e-6),
            stiffness=60.0 * weight / self.size,
            knot=knot,
        )
        self._take_over()
        self.numbers[1].append(self.journal.add_string(self.frame, string))
        self._rebuild(self.live.model_copy(update={"string": [*self.live.string, string]}))
        return len(self.live.string) - 1

    def cut(self, string: int) -> None:
        """Cut a string of the live scene."""
        self._take_over()
        self.journal.end(self.journal.strings, self.numbers[1].pop(string), self.frame)
        strings = [*self.live.string[:string], *self.live.string[string + 1 :]]
        self.hands = {who: held - (held > string) for who, held in self.hands.items() if held != string}
        self._rebuild(self.live.model_copy(update={"string": strings}))

    def cut_all(self) -> None:
        """Cut every string but the hands."""
        for string in reversed(range(len(self.live.string))):
            if string not in self.hands.values():
                self.cut(string)

    def grab(self, who: object, particle: int, place: NDArray) -> None:
        """Take hold of a particle; the hand is at a place."""
        self.release(who)
        self.hands[who] = self.tie(particle, place, length=1e-3 * self.size, knot=False)

    def pull(self, who: object, place: NDArray) -> None:
        """Move a hand, where it holds anything."""
        if who in self.hands:
            anchor = [float(x) for x in place]
            self.live = override_scene(self.live, [(f"string.{self.hands[who]}.anchor", anchor)])
            anchors = [string.anchor for string in self.live.string]
            self.simulator.set_parameters({"string_anchor": np.array(anchors)})
            self.journal.change(self.frame, f"string.{self.numbers[1][self.hands[who]]}.anchor", anchor)

    def release(self, who: object) -> None:
        """Release the point that a window holds."""
        if who in self.hands:
            self.cut(self.hands[who])

    @property
    def points(self) -> NDArray[np.float32]:
        """Points of all balloons [m], shape (particle_count, 3)."""
        return self.simulator.state.points.numpy()[0]

    def moment(self) -> Moment:
        """Return the current moment, to come back to."""
        return Moment(
            frame=self.frame,
            scene=self.live,
            journal=self.journal.copy(),
            numbers=(list(self.numbers[0]), list(self.numbers[1])),
            substeps=self.simulator.model.substeps,
            hands=dict(self.hands),
            state={name: np.array(array.numpy()) for name, array in self.simulator.state.arrays.items()},
        )

    def return_to(self, moment: Moment) -> None:
        """Go on from a moment; later actions are undone. Nobody holds anything any more."""
        self.journal = moment.journal.copy()
        self.numbers = list(moment.numbers[0]), list(moment.numbers[1])
        self._untouched, self.hands = False, dict(moment.hands)
        self.simulator.drop_planned_changes()
        self._rebuild(moment.scene, [None] * len(moment.scene.sphere), moment.substeps)
        for name, values in moment.state.items():
            self.simulator.state.arrays[name].assign(values)
        self.simulator.frame_number = moment.frame
        for who in list(self.hands):
            self.release(who)

    def _set(self, changes: list[tuple[str, Any]]) -> None:
        """Set all of the values or none, and plan the model once."""
        override_scene(self.live, changes)
        self._take_over()
        scene = override_scene(self.live, changes)
        model, simulator = self.simulator.model, self.simulator
        asked = replace(model, scene=model.scene.model_copy(update={"substeps": self._asked_substeps(scene)}))
        setting = plan_setting(asked, dict(changes), (), self.frame)
        self._require_playable(setting.substeps)
        substeps = max(setting.substeps, self._least_substeps) if self.keep_stable else model.substeps
        simulator.go_on_with(replace(setting, substeps=substeps))
        self.live = scene
        for path, value in changes:
            self.journal.change(self.frame, path, value)
        if substeps != model.substeps:
            self.journal.change(self.frame, "substeps", substeps)

    def _take_over(self) -> None:
        """Cancel the scene's own planned changes, from the first interaction on."""
        if not self._untouched:
            return
        self._untouched = False
        scene, before = self.start, max(self.frame - 1, 0)
        for frame, changed in scenes_over_time(self.start):
            if frame < self.frame:
                scene = changed
        self.simulator.drop_planned_changes()
        self.journal.forget_what_was_planned(self.frame)
        lasting = (scene.sphere, scene.string)
        there = [[n for n, body in enumerate(bodies) if is_there(scene, body, before)] for bodies in lasting]
        self.numbers = there[0], there[1]
        lengths = self.simulator.model.parameters["string_length"].numpy()[0].tolist()
        forever = {"start": 0.0, "end": None}
        spheres = [scene.sphere[n].model_copy(update=forever) for n in there[0]]
        strings = [scene.string[n].model_copy(update={**forever, "length": lengths[n]}) for n in there[1]]
        self.live = scene.model_copy(update={"change": [], "sphere": spheres, "string": strings})
        self._rebuild(self.live, there[0])

    def _plan(self, scene: Scene) -> ModelPlan:
        """Plan a scene with as many substeps as it needs.

        Raises:
            InputError: it needs too many.
        """
        scene = scene.model_copy(update={"substeps": self._asked_substeps(scene)})
        first, moduli = self._first_model, self.simulator.model.parameters[SHEAR_MODULUS.name].numpy()[0]
        bounded = first.strain_bound.films if first.strain_bound else ()
        films = {film.number: float(moduli[film.number]) for film in bounded}  # whatever the pressure is by now
        plan = plan_model(scene, shapes=first.shapes, laws=first.own_laws, films=films)
        self._require_playable(plan.substeps)
        values = plan.parameters["keyframe_values"]  # as many as at the start, for a bit-identical replay
        missing = self._first_model.parameters["keyframe_values"].shape[2] - values.shape[2]
        values = np.pad(values, [(0, 0), (0, 0), (0, missing)], mode="edge")
        parameters = {**plan.parameters, "keyframe_values": values}
        return replace(plan, parameters=parameters, substeps=max(plan.substeps, self._least_substeps))

    def _asked_substeps(self, scene: Scene) -> int | Literal["auto"]:
        """Return the substeps to ask for: "auto", or the current ones where a user wants to see instability."""
        unstable = scene.solver == "forward_euler" and not self.keep_stable
        return self.simulator.model.substeps if unstable else "auto"

    def _require_playable(self, substeps: int) -> None:
        if self.keep_stable and substeps > MOST_SUBSTEPS:
            raise InputError(
                f"a stable step needs {substeps:,} substeps a frame, too many for real time; with the current substeps "
                "the simulation would blow up"
            )

    def _rebuild(
        self,
        scene: Scene,
        spheres: Sequence[int | None] | None = None,
        substeps: int | None = None,
    ) -> None:
        """Go on in a scene with other spheres or strings."""
        plan = self._plan(scene)
        running = self.simulator.model.substeps
        wanted = substeps or (plan.substeps if self.keep_stable else running)
        if wanted != running and substeps is None:
            self.journal.change(self.frame, "substeps", wanted)
        self.live = scene
        model = lay_out(plan, self.simulator.model.device)
        times = self._first_model.keyframe_times
        self.simulator.go_on_in(replace(model, substeps=wanted, keyframe_times=times), spheres)


APART_SECONDS = 0.5
"""Simulated time between two kept moments [s]"""
MOST = 12
SWOLLEN = 3.0
"""Size over that at the first moment, above which a shape is not worth returning to"""


class Moments:
    """Last moments of a simulation, oldest first."""

    def __init__(self) -> None:
        self._kept: deque[Moment] = deque(maxlen=MOST)

    def clear(self) -> None:
        """Drop all kept moments."""
        self._kept.clear()

    def note(self, playground: Playground) -> None:
        """Keep the current moment, if enough time has passed since the last."""
        if not self._kept or playground.frame - self._kept[-1].frame >= _frames_apart(playground):
            self._kept.append(playground.moment())

    def go_back(self, playground: Playground) -> bool:
        """Go back to the last good moment, and the next time to the one before; return whether there was one.

        It is at least half of the time between two ago, and before it swelled past recognition.
        """
        kept, apart = self._kept, _frames_apart(playground)
        while len(kept) > 1 and (
            playground.frame - kept[-1].frame < apart / 2 or kept[-1].extent > SWOLLEN * kept[0].extent
        ):
            kept.pop()
        if not kept:
            return False
        playground.return_to(kept.pop())
        return True


def _frames_apart(playground: Playground) -> float:
    return APART_SECONDS / playground.simulator.model.frame_seconds


COMPILER_NICENESS = 15
"""Niceness of the process: the simulation and the browser come first"""
BURST = 1e9
"""Factor on the inflation under which every skin gives way"""


class KernelPrecompiler:
    """The process that fills Warp's kernel cache, from which the page's own then loads: one at a time, of one scene."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._waiter: threading.Thread | None = None
        self._done: set[Kinds] = set()

    @property
    def busy(self) -> bool:
        """Return whether the process is compiling."""
        return self._process is not None and self._process.poll() is None

    def has(self, kinds: Kinds) -> bool:
        """Return whether nothing is gained by waiting for the kernels of a scene with such things in it."""
        return not self.busy or kinds in self._done

    def begin(
        self, scene: Scene, device: str, laws: Sequence[Law] = (), on_done: Callable[[], None] = lambda: None
    ) -> None:
        """Compile the kernels that playing with a scene takes, and stop compiling those of another scene.

        Nothing is done where all was compiled before, or where only this process knows the laws.

        Args:
            on_done: called, by another thread, whenever `has` may return more.
        """
        self.end()
        task = _task(scene, device, laws)
        if task is None or _mark(scene, device, laws).exists():
            return
        found = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
        found["WARP_CACHE_PATH"] = str(_kernels().parent)  # Warp appends its version
        command, pipe = (
            [sys.executable, "-c", f"from {__name__} import compile_ahead; compile_ahead()"],
            subprocess.PIPE,
        )
        try:
            process = subprocess.Popen(
                command, stdin=pipe, stdout=pipe, stderr=subprocess.DEVNULL, env=found, start_new_session=True
            )
        except OSError:  # no room for a process: it is compiled when it is asked for
            return
        self._process, self._done = process, set()
        arguments = (process, task, self._done, on_done)
        self._waiter = threading.Thread(target=_tell_and_hear, args=arguments, name="ahead", daemon=True)
        self._waiter.start()

    def end(self) -> None:
        """Compile nothing any more."""
        if self._process and self._waiter:
            self._process.kill()
            self._waiter.join()
        self._process = self._waiter = None


def _kernels() -> Path:
    """Return the folder of Warp's kernel cache."""
    return Path(str(wp.config.kernel_cache_dir))


def _task(scene: Scene, device: str, laws: Sequence[Law]) -> bytes | None:
    """Return the task for the process, or None where it would not know the laws."""
    if any(law.force.func.__module__ == "__main__" for law in laws):
        return None
    try:
        return pickle.dumps((scene, device, tuple(laws), wp.config.optimization_level))
    except (pickle.PicklingError, AttributeError, TypeError):
        return None


def _mark(scene: Scene, device: str, laws: Sequence[Law]) -> Path:
    """Return the path of a file that marks, beside Warp's kernel cache, that a scene's kernels are complete."""
    what = json.dumps(
        [device, wp.config.optimization_level, describe_simulation(scene, laws, 0)], sort_keys=True, default=str
    )
    return _kernels() / f"balloon_warp_ahead_{hashlib.sha256(what.encode()).hexdigest()[:16]}"


def _tell_and_hear(
    process: "subprocess.Popen[bytes]", task: bytes, done: set[Kinds], on_done: Callable[[], None]
) -> None:
    """Send the task to the process, and note its progress.

    The pipe stays open as long as this process lives, which tells the other that it does.
    """
    assert process.stdin
    assert process.stdout
    with contextlib.suppress(BrokenPipeError):
        process.stdin.write(len(task).to_bytes(8, "little") + task)
        process.stdin.flush()
    for line in process.stdout:
        done.add(frozenset(json.loads(line)))
        on_done()
    process.wait()
    on_done()
    _tidy(process.pid)
    process.stdout.close()
    with contextlib.suppress(BrokenPipeError):
        process.stdin.close()


def _tidy(process: int) -> None:
    """Delete the unfinished kernels of a process that was ended."""
    for begun in _kernels().glob(f"*_p{process}_*"):
        shutil.rmtree(begun, ignore_errors=True)


def precompile_actions(playground: Playground, on_done: Callable[[Kinds], None] = lambda kinds: None) -> None:
    """Run common actions, a frame each, so that their kernels are compiled: the likeliest first.

    Args:
        on_done: called with the kinds of things whose kernels are there, and with `REASON` beside them after a burst.
    """

    def inflate() -> None:
        playground.inflate(1.01 * playground.inflation)

    def throw() -> None:
        above = playground.points.mean(axis=0) + 2.0 * playground.size * np.array(playground.live.up)
        playground.throw(above, np.zeros(3), 0.1 * playground.size, 1.0)

    def pull() -> None:
        playground.grab("hand", 0, playground.points[0] + 0.1 * playground.size)

    def blow() -> None:
        playground.blow([1.0, 0.0, 0.0])

    def burst() -> None:
        playground.keep_stable = False
        playground.inflate(BURST * max(playground.inflation, 1.0))

    def see_forces() -> None:
        playground.simulator.read_frame(net_forces=True)

    cut = playground.cut_all
    acts: list[list[Callable[[], None]]] = [
        *([inflate], [throw], [burst], [pull], [throw, burst], [throw, pull], [cut], [cut, burst], [cut, throw]),
        *([cut, throw, burst], [pull, burst], [throw, pull, burst], [blow], [blow, burst], [blow, throw]),
        *([blow, pull], [blow, throw, pull], [cut, blow], [cut, pull], [inflate, see_forces]),
    ]
    for some in acts:
        playground.reset()
        playground.keep_stable = True
        for act in some:
            with contextlib.suppress(InputError):
                act()
                if find_reason := playground.step():
                    find_reason()
                    on_done(kinds_of(playground.live) | REASON)
        on_done(kinds_of(playground.live))


def _tell(page: TextIO, kinds: Kinds) -> None:
    """Report progress to the page."""
    print(json.dumps(sorted(kinds)), file=page, flush=True)


def _end_with_the_page() -> None:
    """End when the pipe is closed, however the page's process ended."""
    sys.stdin.buffer.read(1)
    _tidy(os.getpid())
    os._exit(0)


def compile_ahead() -> None:
    """Read a task from standard input, and do it, as long as that stays open."""
    if hasattr(os, "nice"):
        os.nice(COMPILER_NICENESS)
    quiet_warp()
    length = int.from_bytes(sys.stdin.buffer.read(8), "little")
    task = sys.stdin.buffer.read(length)
    threading.Thread(target=_end_with_the_page, daemon=True).start()
    scene, device, laws, wp.config.optimization_level = pickle.loads(task)
    page = sys.stdout
    with contextlib.redirect_stdout(sys.stderr):  # of others, who would be taken for what is done
        precompile_actions(Playground(scene, device, laws), functools.partial(_tell, page))
    _mark(scene, device, laws).touch()
