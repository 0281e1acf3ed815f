"""The simulator: a scene in, frames out."""

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any, Self

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from balloon_warp.blow_ups import BlowUp, Origin, Origins, diagnose
from balloon_warp.device import pick_device
from balloon_warp.errors import InputError
from balloon_warp.frame import Frame
from balloon_warp.frame_reader import FrameReader
from balloon_warp.garbage import without_collecting
from balloon_warp.kernels.laws import Law
from balloon_warp.model import (
    DueChange,
    Model,
    Vary,
    build_model,
    carry_over,
    fitting,
    initial_state,
    overwrite,
    world_bytes,
)
from balloon_warp.model.gas import keep_pressures
from balloon_warp.model.memory import require_memory
from balloon_warp.model.varied_scene import scene_to_vary
from balloon_warp.model.vary import METHODS
from balloon_warp.reading import Reading
from balloon_warp.running import Running
from balloon_warp.scene import SceneLike
from balloon_warp.schedules.late_spheres import LateSpheres
from balloon_warp.solids import MassProperties, mass_properties
from balloon_warp.solvers.choose import solver_named


class Simulator(Running):
    """Advances a batch of worlds frame by frame.

    Args:
        scene: what to simulate: a scene, the name of a bundled one, a scene file, or a mesh, as a file or in memory.
        device: a Warp device such as "cpu" or "cuda:0"; if missing, the GPU or else the CPU.
        world_count: how many copies of the scene.
        vary: what differs between the worlds: dotted paths as in overrides, and arrays of shape (world_count,), such as
            {"balloon.inflation.k_normal": np.linspace(0.0, 8.0, 64)}.
        schedule: how the work is laid out: "scatter", "gather", "block", "lanes", "octets", or "auto" for the
            fastest.
        laws: your own, which act beside the built-in ones; see `balloon_warp.laws`.

    Raises:
        InputError: the scene's meshes, particles or step are wrong, a varied value or a law is, the worlds do not fit
            into the device's memory, or there is no such device or schedule.
    """

    def __init__(
        self,
        scene: SceneLike,
        device: str | None = None,
        world_count: int = 1,
        vary: Vary | None = None,
        schedule: str = "auto",
        laws: Sequence[Law] = (),
    ):
        self._begin(build_model(scene_to_vary(scene, vary), pick_device(device), world_count, vary, laws), schedule)

    @classmethod
    def of_model(cls, model: Model, schedule: str = "auto") -> Self:
        """A simulator of a model that is laid out already.

        Raises:
            InputError: the worlds do not fit into the device's memory, or there is no such schedule.
        """
        simulator = cls.__new__(cls)
        simulator._begin(model, schedule)
        return simulator

    @without_collecting()
    def _begin(self, model: Model, schedule: str) -> None:
        kind = solver_named(schedule, model)
        require_memory(model.device, [model.world_count], [world_bytes(model) + kind.world_bytes(model)])
        self._turns, self._asked_schedule = deque(model.turns), schedule
        self._origins = Origins(Origin(model, kind.name))
        self._first = model, schedule
        self.model = model.with_own_parameters() if model.turns else model
        self.schedule = kind(self.model)  # while a thread still compiles what places balloons
        self.state = initial_state(model)
        self._late_spheres = LateSpheres(model)
        self.frame_number = 0
        self._forget_records()

    def reset(self) -> None:
        """Back to the start, as it was when the simulator was made: parameters and methods, too."""
        self._forget_records()
        del self.state, self.schedule  # their memory is wanted
        self._begin(*self._first)

    @classmethod
    def from_origin(cls, origin: Origin) -> Self:
        """A simulator that goes on from a state that was kept."""
        simulator = cls.of_model(origin.model, origin.schedule)
        simulator.frame_number = origin.frame
        if origin.state:
            overwrite(simulator.state, origin.state)
        return simulator

    def _begin_step(self) -> None:
        self.take_due_turns()
        if self._origins.is_due(self.model, self.frame_number):
            model = replace(self.model, turns=list(self._turns))
            self._origins.keep(Origin(model, self._asked_schedule, self.frame_number, self.state))
        self.advance()

    @property
    def _waits(self) -> bool:
        return self._turn_is_due or self._origins.is_due(self.model, self.frame_number)

    def advance(self) -> None:
        """Advance every world by one frame, without a look at which ones blew up."""
        self.take_due_turns()
        if self.schedule.capturable:
            wp.capture_launch(self._frame_graph)
        else:
            self._advance_frame()
        self.frame_number += 1

    def read_frame(self, world: int = 0, net_forces: bool | None = None) -> Frame:
        """Copy one world to the host.

        Args:
            net_forces: whether they are wanted, and the inflation's; as the scene says, when missing.

        Raises:
            InputError: there is no such world.
        """
        return self._begin_reading(world, net_forces).frame()

    def _begin_reading(self, world: int, net_forces: bool | None = None, buffer: int = 0) -> Reading:
        if not isinstance(world, int | np.integer) or not 0 <= world < self.model.world_count:
            raise InputError(f"world: there is no world {world}; expected 0 to {self.model.world_count - 1}")
        wanted = self.model.scene.net_forces if net_forces is None else net_forces
        return self._frame_reader.begin(self.state, self.frame_number, world, wanted, buffer)

    def mass_properties(self) -> MassProperties:
        """Volume, center of mass and inertia tensor of every balloon as a solid, in every world."""
        return mass_properties(self.model, self.state.points)

    def set_parameters(self, parameters: Mapping[str, ArrayLike]) -> None:
        """Write parameters where the kernels read them; they hold from the next frame on.

        Args:
            parameters: arrays by their names in `Model.parameters`, of the shapes there; a row for all worlds, too.

        Raises:
            InputError: there is no such parameter, or its values have another shape or are not finite.
        """
        written = {name: fitting(self.model, name, values) for name, values in parameters.items()}
        self._origins.forget()  # what comes now does not follow from them
        keep_pressures(self.model, self.state, written)
        first, schedule = self._first
        if first.parameters is self.model.parameters:
            self._first = first.with_own_parameters(), schedule
        for name, values in written.items():
            self.model.parameters[name].assign(values)
        if not self.schedule.depends_on.isdisjoint(parameters):
            self._make_schedule()

    def go_on_in(self, model: Model, spheres: Sequence[int | None] | None = None) -> None:
        """Go on from here in another model of the same balloons.

        Args:
            model: with other substeps, say, or with more or fewer spheres and strings.
            spheres: for each sphere of the model its number until now, or None if it is new and starts where the model
                puts it; all as they are, when missing.
        """
        self._origins.forget()
        if spheres is not None:
            until_now, self.state = self.state, initial_state(model)
            carry_over(self.state, until_now, spheres)
        if model.scene.contact != self.model.scene.contact:  # where momentum is exchanged, they have acted already
            self.state.sphere_forces.zero_()
        if model.scene.solver != self.model.scene.solver:
            self._asked_schedule = "auto"  # what was asked for may be of the other solver
        self.model = model
        self._late_spheres = LateSpheres(model)
        self._make_schedule()

    def _make_schedule(self) -> None:
        """The schedule of the model as it is now, and nothing left of the last."""
        self.schedule = solver_named(self._asked_schedule, self.model)(self.model)
        self._forget_records()

    def _forget_records(self) -> None:
        """What was recorded or laid out for another schedule."""
        for cached in ("_frame_graph", "_frame_reader"):
            vars(self).pop(cached, None)

    def diagnose(self, world: int, frame: int, bad: int | None = None) -> BlowUp:
        """Why a world blew up. Its last frames are simulated again, by themselves, to find out.

        Args:
            bad: its first bad particle or sphere then; as the state has it, when missing.
        """
        again = self.from_origin(self._origins.last.of_world(world))
        while again.frame_number < frame - 1:
            again.advance()
        again.take_due_turns()
        if bad is None:
            bad = int(self.state.first_bad.numpy()[world])
        return diagnose(again.model, again.state, again.schedule, world, frame, bad)

    def restore(self, saved: Mapping[str, NDArray]) -> None:
        """Go on, bit for bit, from where another simulator of the same scene, worlds and schedule was.

        Only at the start: what the scene has changed until then, of parameters and methods, is changed again.

        Args:
            saved: the contents of that one's state, by the names of its fields.
        """
        frame = int(saved["frame"][0])
        self.frame_number = frame - 1
        self.take_due_turns()
        self.frame_number = frame
        self._origins.forget()
        for name, array in vars(self.state).items():
            if array.size:  # what the scene does not have may not be among what was saved
                array.assign(saved[name])

    def drop_turns(self) -> None:
        """Forget the changes that the scene has planned from here on."""
        self._turns.clear()
        self._origins.forget()

    @property
    def _turn_is_due(self) -> bool:
        return bool(self._turns) and self._turns[0].frame <= self.frame_number

    def take_due_turns(self) -> None:
        """Make the changes that the scene has planned for the start of the next frame."""
        while self._turn_is_due:
            self._take_turn(self._turns.popleft())

    def _take_turn(self, turn: DueChange) -> None:
        """Change what the scene says changes at this frame."""
        changed = {name: self.model.parameters[name].numpy().copy() for name in turn.values}
        for name, rows in changed.items():
            turn.apply(name, rows)
        self.set_parameters(changed)
        methods = {name: getattr(turn.scene, name) for name in METHODS}
        if any(getattr(self.model.scene, name) != method for name, method in methods.items()):
            substeps = self.model.substeps if turn.scene.substeps == "auto" else turn.scene.substeps
            scene = self.model.scene.model_copy(update=methods)
            self.go_on_in(replace(self.model, scene=scene, substeps=substeps))

    @cached_property
    def _frame_reader(self) -> FrameReader:
        return FrameReader(self.model)

    @cached_property
    def _frame_graph(self) -> Any:
        """A frame, recorded once to be replayed without the cost of its launches."""
        with wp.ScopedDevice(self.model.device), wp.ScopedCapture(self.model.device) as capture:
            self._advance_frame()
        return capture.graph

    def _advance_frame(self) -> None:
        self.schedule.advance_frame(self.state)
        self._late_spheres.hold(self.state)
