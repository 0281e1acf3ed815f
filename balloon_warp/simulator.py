"""The simulator: a scene in, frames out; and balloons as solids, with mass and inertia."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from balloon_warp.blow_ups import BlowUp, Origin, Origins, diagnose
from balloon_warp.errors import BlowUpError, InputError
from balloon_warp.frame import Frame, FrameReader, Reading, go_back_to, packed, plain_values, relax
from balloon_warp.kernels.laws import Law
from balloon_warp.kernels.measure.worlds import SolidSums, measure_solids, sum_solids
from balloon_warp.kernels.tables import HEALTHY
from balloon_warp.model import Model, Vary, build_model, carried_over, fitting, initial_state, world_bytes, worlds_of
from balloon_warp.model.parameters import active_laws_and_phases, scene_to_vary
from balloon_warp.model.plan import remarks_in_sentences
from balloon_warp.model.pressure import keep_pressures
from balloon_warp.model.setting import PlannedChanges, Setting, changed_parameters, plan_setting, with_changed_methods
from balloon_warp.model.state import carry_kept_values, require_memory
from balloon_warp.scene import SceneLike
from balloon_warp.schedules.choose import Schedule
from balloon_warp.schedules.frames import RecordedFrame
from balloon_warp.schedules.touch_table import overflow_remarks
from balloon_warp.solvers import solver_named
from balloon_warp.steering import Controls, Observations, Starts
from balloon_warp.system.api import Shown, checked, described
from balloon_warp.system.process import LENT, without_garbage_collection
from balloon_warp.system.warp_threads import PROCESS_LOCK, launch, lock_of, locked, pick_device

LANES = 32
"""Number of threads that sum a balloon; constant, so that a world's sums do not depend on its batch"""


@described
@dataclass(frozen=True)
class MassProperties(Shown):
    """Volume, center of mass and inertia of every balloon, as a solid of density 1 kg/m^3.

    Multiply by a density to get those of a material.

    They are exact for the polyhedron whose faces are fans of triangles about their centers (Kim et al. 2006). For open
    balloons they are meaningless.
    """

    closed: NDArray[np.bool_]
    """Whether the balloon has an inside, shape (balloon_count,)"""
    volume: NDArray[np.float64]
    """Volume [m^3], shape (world_count, balloon_count)"""
    center: NDArray[np.float64]
    """Center of mass [m], shape (world_count, balloon_count, 3)"""
    inertia: NDArray[np.float64]
    """Inertia tensor at unit density about the center of mass, along the axes of the world [m^5], shape (world_count,
    balloon_count, 3, 3)"""


def mass_properties(model: Model, points: wp.array) -> MassProperties:
    """Measure balloons on the device, bit-identically every time.

    Args:
        model: of the balloons.
        points: [m], shape (world_count, particle_count), vec3.
    """
    shape = (model.world_count, model.balloon_count)
    offsets = np.cumsum([0, *(balloon.mesh.face_count for balloon in model.shapes)])

    def zeros(shape: tuple[int, ...], dtype: Any) -> wp.array:
        return wp.zeros(shape, dtype=dtype, device=model.device)

    sums = zeros((*shape, LANES), SolidSums)
    measures = [zeros(shape, wp.float64), zeros(shape, wp.vec3d), zeros(shape, wp.mat33d)]
    topology = [wp.array(offsets, dtype=wp.int32, device=model.device), model.face_offsets, model.face_particles]
    launch(sum_solids, sums.shape, inputs=[*topology, points], outputs=[sums], device=model.device)
    launch(measure_solids, shape, inputs=[*topology, points, sums], outputs=measures, device=model.device)
    # copies: on the CPU numpy() alone is a view
    volume, center, inertia = (np.array(array.numpy(), dtype=np.float64) for array in measures)
    return MassProperties(np.array([balloon.closed for balloon in model.shapes]), volume, center, inertia)


class Simulator(Shown):
    """Advances a batch of worlds frame by frame.

    Args:
        scene: Scene, name of a bundled one, scene file, or mesh, as a file or in memory.
        device: Warp device such as "cpu" or "cuda:0"; the GPU, or else the CPU, if not given.
        world_count: Number of worlds, copies of the scene; as many as `vary` has values, if not given.
        vary: Values that differ between worlds: dotted paths as in overrides, and arrays of shape (world_count,),
            such as {"balloon.inflation.k_normal": np.linspace(0.0, 8.0, 64)}.
        schedule: Parallel schedule: "scatter", "gather", "block", "lanes", "octets", or the fastest, "auto".
        laws: User-defined laws beside the built-in ones; see `balloon_warp.laws`.

    Raises:
        InputError: the scene's meshes, particles or step are wrong, a varied value or a law is, the worlds do not fit
            into the device's memory, or there is no such device or schedule.
    """

    _internal = (
        *("advance", "diagnose", "drop_planned_changes", "go_on_in", "go_on_with"),
        *("make_due_changes", "of_model", "record_again", "schedule", "set_parameters", "step_unexplained"),
        "step_unread",
    )

    @checked
    def __init__(
        self,
        scene: SceneLike,
        device: str | None = None,
        world_count: int | None = None,
        vary: Vary | None = None,
        schedule: str = "auto",
        laws: Sequence[Law] = (),
    ):
        self._varied = vary or {}
        with PROCESS_LOCK:
            worlds = worlds_of(world_count, vary)
            self._begin(build_model(scene_to_vary(scene, vary), pick_device(device), worlds, vary, laws), schedule)

    @classmethod
    def of_model(cls, model: Model, schedule: str = "auto") -> Self:
        """Make a simulator of a model that is laid out already.

        Raises:
            InputError: the worlds do not fit into the device's memory, or there is no such schedule.
        """
        simulator = cls.__new__(cls)
        simulator._varied = None
        with PROCESS_LOCK:
            simulator._begin(model, schedule)
        return simulator

    @without_garbage_collection()
    def _begin(self, model: Model, schedule: str) -> None:
        kind = solver_named(schedule, model)
        require_memory(model.device, [model.world_count], [world_bytes(model) + kind.world_bytes(model)])
        self._planned, self._asked_schedule = PlannedChanges(model.due_changes), schedule
        self._origins, self._first = Origins(Origin(model, kind.name)), (model, schedule)
        self.model = model.with_own_parameters() if model.due_changes else model
        if not hasattr(self, "controls"):
            self.controls, self.observations, self.starts = Controls(self), Observations(self), Starts(self)
        self._lay_out(kind)  # while a thread still compiles the kernels that place balloons
        self.state, self.frame_number = initial_state(model), 0
        self._changes_set: list[tuple[int, dict[str, Any]]] = []
        self.starts.begin_again()

    @locked
    def reset(self, worlds: Any = None) -> None:
        """Go back to the start, as it was when the simulator was made: parameters and methods, too.

        Args:
            worlds: Mask of the worlds to reset, on the device, with values that `starts` draws; all if not given.
        """
        if worlds is not None:
            return self.starts.begin(worlds)
        del self.state, self.schedule, self._recorded_frame, self._frame_reader  # their memory is wanted
        self._begin(*self._first)

    @property
    def time(self) -> float:
        """Time simulated since the start [s]."""
        return self.frame_number * self.model.frame_seconds

    @property
    def warnings(self) -> list[str]:
        """Remarks, a sentence each: on odd meshes, their treatment, and numbers other than the requested ones."""
        remarks = remarks_in_sentences(self.model, self.state)
        return [*self.model.warnings, *remarks, *overflow_remarks(self.schedule.overflow)]

    def __repr__(self) -> str:
        return f"Simulator({self.model}, frame {self.frame_number}, {self.time:.3f} s)"

    @checked
    def step(self, frames: int = 1, *, world: int = 0) -> Frame:
        """Advance every world by a frame, or several, and return the last frame of one: `frame = simulator.step()`.

        Raises:
            InputError: there is no such world, or `frames` is below 1; nothing is advanced then.
            BlowUpError: the simulation blew up.
        """
        self.model.require_world(world)
        if frames < 1:
            raise InputError(f"frames: expected at least 1 (got {frames})")
        for _ in range(frames):
            self.step_unread()
        return self.read_frame(world)

    def step_unread(self) -> None:
        """Advance every world by one frame, reading back nothing but health.

        Raises:
            BlowUpError: the simulation blew up.
        """
        if find_reason := self.step_unexplained():
            raise BlowUpError(find_reason())

    @locked
    def step_unexplained(self) -> Callable[[], BlowUp] | None:
        """Advance every world by a frame, as `step_unread` does; after a blow-up, return a function that diagnoses it.

        That may take seconds, and may be called later, even if the simulator has gone on in another model.
        """
        self._begin_step()
        return self._reason_of(np.asarray(self.state.first_bad.numpy(), dtype=np.int32), self.frame_number)

    def run(self, world: int = 0, ahead: bool = False) -> Iterator[Frame]:
        """Yield the frames of one world: the start, then as many as the scene asks for, one after the other.

        A simulator that is past its start gives the frames that are still missing.

        Args:
            ahead: whether the next frame is simulated while the loop works on this one, so that a GPU does not wait.
                For loops that look at the frames alone: the simulator itself is a frame further on.

        Raises:
            BlowUpError: the simulation blew up.
        """
        if self.frame_number == 0:
            yield self.read_frame(world)
        reading, frames = None, self.model.scene.frames
        while reading or self.frame_number < frames:
            if reading and not (ahead and self.frame_number < frames and not self._waits):
                yield self._arrived(reading, world)
                reading = None
                continue
            self._begin_step()
            last, reading = reading, self._begin_reading(world, buffer=self.frame_number % 2)
            if last:
                yield self._arrived(last, world)

    @locked
    def advance(self, frames: int = 1) -> None:
        """Do `step` without waiting for the device: nothing is read back, and no blow-up is looked for."""
        for _ in range(frames):
            self.make_due_changes()
            self._recorded_frame.advance(self.schedule, self.state)
            self.frame_number += 1

    @locked
    def _begin_step(self) -> None:
        """Advance every world by one frame; a GPU goes on in the background."""
        self.make_due_changes()
        if self._origins.is_due(self.model, self.frame_number):
            model = replace(self.model, due_changes=list(self._planned))
            self._origins.keep(Origin(model, self._asked_schedule, self.frame_number, self.state))
        self.advance()

    @property
    def _waits(self) -> bool:
        """Return whether the next frame must wait until the last one is known to be healthy."""
        return self._planned.are_due(self.frame_number) or self._origins.is_due(self.model, self.frame_number)

    def read_frame(self, world: int = 0, net_forces: bool | None = None) -> Frame:
        """Copy one world to the host.

        Args:
            net_forces: whether they are wanted, and the inflation's; as the scene says, when missing.

        Raises:
            InputError: there is no such world.
        """
        return self._begin_reading(world, net_forces).frame()

    def picture(self, world: int = 0, size: tuple[int, int] = (640, 360), samples: int = 4) -> bytes:
        """Take a picture of one world as it is now, as a PNG file has it: `Path("now.png").write_bytes(picture)`.

        Args:
            size: Width and height in pixels.
            samples: Rays per pixel.

        Raises:
            InputError: there is no such world, there is nothing finite to draw, or the size cannot be drawn.
        """
        return LENT["snapshot"](self.model, self.read_frame(world), size, samples)

    def _repr_png_(self) -> bytes | None:
        """Show a notebook the first world, where there is something to be seen."""
        return LENT["notebook_picture"](self.model, self.read_frame(0))

    @locked
    def mass_properties(self) -> MassProperties:
        """Find volume, center of mass and inertia tensor of every balloon as a solid, in every world."""
        return mass_properties(self.model, self.state.points)

    def relax(self, speed: float = 1.0e-3, most_seconds: float = 60.0, world: int = 0) -> Frame:
        """Simulate until everything is at rest, and return that frame.

        Args:
            speed: Largest speed of any particle, for a tenth of a second, up to rounding [m/s].
            most_seconds: Largest simulated time [s].

        Raises:
            InputError: there is no such world, or something still moves then.
            BlowUpError: the simulation blew up.
        """
        self.model.require_world(world)
        relax(self, speed, most_seconds)
        return self.read_frame(world)

    def stiffness(self, world: int = 0, balloon: int = 0) -> Any:
        """Return the tangent stiffness of a balloon [N/m], as SciPy's symmetric operator of shape (3 n, 3 n).

        Raises:
            InputError: there is no such world or balloon.
        """
        return LENT["stiffness_in"](self.model, self.read_frame(world), world, balloon)

    @locked
    def _begin_reading(self, world: int, net_forces: bool | None = None, buffer: int = 0) -> Reading:
        """Send one world as it is now on its way to the host. Two may be, into two buffers."""
        self.model.require_world(world)
        net_forces = self.model.scene.net_forces if net_forces is None else net_forces
        return self._frame_reader.begin(self.state, self.frame_number, world, net_forces, buffer)

    @locked
    def diagnose(self, world: int, frame: int, bad: int | None = None) -> BlowUp:
        """Diagnose a blow-up of a world. Its last frames are simulated again, by themselves.

        Args:
            bad: its first bad particle or sphere then; as the state has it, when missing.
        """
        return self._diagnosis(world, frame, int(self.state.first_bad.numpy()[world]) if bad is None else bad)()

    def _diagnosis(self, world: int, frame: int, bad: int) -> Callable[[], BlowUp]:
        """Return a function that diagnoses a blow-up, from the state before its last frames."""
        origin = self._origins.last.of_world(world)

        def find() -> BlowUp:
            with lock_of(origin.model.device):
                again = origin.advance(Simulator.of_model(origin.model, origin.schedule), frame)
                return diagnose(again.model, again.state, again.schedule, world, frame, bad)

        return find

    def _arrived(self, reading: Reading, world: int) -> Frame:
        """Return a frame that was read, if all worlds were well in it."""
        if find_reason := self._reason_of(reading.first_bad(), reading.number):
            raise BlowUpError(find_reason())
        frame = reading.frame()
        if not frame.is_finite:
            raise BlowUpError(self.diagnose(world, frame.number))
        return frame

    def _reason_of(self, first_bad: NDArray[np.int32], frame: int) -> Callable[[], BlowUp] | None:
        """Return a function that diagnoses a blow-up; None if all worlds are well."""
        self.controls.require_sound()
        worlds = np.flatnonzero(first_bad != HEALTHY)
        return self._diagnosis(int(worlds[0]), frame, int(first_bad[worlds[0]])) if worlds.size else None

    @locked
    def set(self, changes: Mapping[str, Any]) -> None:
        """Set values from now on, by their paths in the scene, as in {"balloon.mass": 3.0, "normals": "cached"}.

        A number may be given for each world, as an array of shape (world_count,), and a vector as one of shape
        (world_count, 3). A number takes the place of keyframes. Values are checked as those of a file, before any is
        set. An automatic step becomes as long as they allow. Later changes that the scene plans still happen.

        A mesh's treatment cannot change, nor the number of things, nor a value that counts at the start alone, such as
        positions: `load_scene(scene, {...})` makes another scene of those.

        Raises:
            InputError: names the path that is not there, or cannot change, or has a value that cannot be; or the step,
                which the scene says, would be too long.
        """
        self.make_due_changes()
        self.go_on_with(plan_setting(self.model, changes, list(self._planned), self.frame_number))
        self._changes_set.append((self.frame_number, plain_values(changes)))

    @locked
    def go_on_with(self, setting: Setting) -> None:
        """Go on with the values that are set."""
        if setting.differs_by_world(self.model):
            self.go_on_in(self.model.with_rows_of_worlds())
        acted, changes_methods = active_laws_and_phases(self.model), setting.changes_methods(self.model)
        self.set_parameters(setting.parameters)
        model = replace(self.model, scene=setting.scene, substeps=setting.substeps)
        if changes_methods or active_laws_and_phases(model) != acted:
            self.go_on_in(model)
        else:
            self.model = model

    @locked
    def set_parameters(self, parameters: Mapping[str, ArrayLike]) -> None:
        """Write parameters where the kernels read them; they hold from the next frame on.

        Args:
            parameters: arrays by their names in `Model.parameters`, of the shapes there; a row for all worlds, too.

        Raises:
            InputError: there is no such parameter, or its values have another shape or are not finite.
        """
        written = {name: fitting(self.model, name, values) for name, values in parameters.items()}
        self._origins.forget()  # later frames do not follow from them
        keep_pressures(self.model, self.state, written)
        first, schedule = self._first
        if first.parameters is self.model.parameters:
            self._first = first.with_own_parameters(), schedule
        for name, values in written.items():
            self.model.parameters[name].assign(values)
        self.controls.follow()
        if not self.schedule.depends_on.isdisjoint(parameters):
            self._lay_out(solver_named(self._asked_schedule, self.model))

    @locked
    def go_on_in(self, model: Model, spheres: Sequence[int | None] | None = None) -> None:
        """Go on from here in another model of the same balloons.

        Args:
            model: with other substeps, say, or with more or fewer spheres and strings.
            spheres: for each sphere of the model its number until now, or None if it is new and starts where the model
                puts it; all as they are, when missing.
        """
        self._origins.forget()
        if spheres is not None:
            self.state = carried_over(model, self.state, spheres)
        if model.scene.contact != self.model.scene.contact:  # where momentum is exchanged, they have acted already
            self.state.sphere_forces.zero_()
        if model.scene.solver != self.model.scene.solver:
            self._asked_schedule = "auto"  # the requested schedule may be of the other solver
        self.model = model
        self.state.kept = carry_kept_values(model, self.state.kept)
        self._lay_out(solver_named(self._asked_schedule, self.model))

    def _lay_out(self, kind: type[Schedule]) -> None:
        """Make the schedule of the model as it is now, and the recorder and the reader of its frames."""
        self.schedule = kind(self.model)
        self._frame_reader = FrameReader(self.model)
        self.record_again()

    def record_again(self) -> None:
        """Record the next frame, with the controls and observations that are open."""
        ends = self.controls.move, self.observations.refresh
        self._recorded_frame = RecordedFrame(self.model, self.starts.write, *ends)
        self.starts.forget()

    def make_due_changes(self) -> None:
        """Make the changes that the scene has planned for the start of the next frame."""
        for change in self._planned.due(self.frame_number):
            self.set_parameters(changed_parameters(change, self.model))
            if change.methods:
                self.go_on_in(with_changed_methods(change, self.model))

    def drop_planned_changes(self) -> None:
        """Forget the changes that the scene has planned from here on."""
        self._planned.clear()
        self._origins.forget()

    @locked
    def save(self) -> dict[str, NDArray]:
        """Return the state for `restore`, as arrays by name: `np.savez("here.npz", **simulator.save())` keeps it.

        Places and velocities of all worlds are `points` and `velocities`.
        """
        return packed(self.state, self._changes_set) | self.controls.saved() | self.starts.saved()

    @locked
    def restore(self, saved: Mapping[str, NDArray]) -> None:
        """Restore a saved state of a simulator of the same scene, worlds and schedule, bit for bit.

        It may be this one or another. Changes of parameters and methods until then are repeated.

        Args:
            saved: Arrays of `save`, or their file: `np.load("here.npz")`.
        """
        if self.frame_number or self._changes_set:
            self.reset()
        go_back_to(self, saved)
        self._origins.forget()

    def __deepcopy__(self, memo: Any) -> Self:
        """Return another simulator of the same worlds on the same device, restored to the saved state of this one."""
        model, schedule = self._first
        other = self.of_model(model.with_own_parameters(), schedule)
        other._varied = self._varied
        other.restore(self.save())
        return other

    def __copy__(self) -> Self:
        """Return a deep copy: two simulators do not share a state."""
        return self.__deepcopy__({})

    def __reduce__(self) -> tuple[Any, ...]:
        """Return for `pickle` how another process makes a simulator of the same scene, and the saved state.

        Raises:
            InputError: the simulator is of a model, and not of a scene.
        """
        if self._varied is None:
            raise InputError("a simulator of a model cannot be pickled; expected what save() returns")
        model, schedule = self._first
        of_scene = model.scene, str(model.device), model.world_count, self._varied, schedule, model.own_laws
        return _restored, (of_scene, self.save())


def _restored(of_scene: tuple[Any, ...], saved: Mapping[str, NDArray]) -> Simulator:
    """Make the simulator that was pickled."""
    simulator = Simulator(*of_scene)
    simulator.restore(saved)
    return simulator
