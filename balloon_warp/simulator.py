"""The simulator: a scene in, frames out."""

from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Self

import numpy as np
import warp as wp

from balloon_warp.beginning import Beginning
from balloon_warp.blow_ups import BlowUp, Origin, Origins, diagnose
from balloon_warp.device import pick_device
from balloon_warp.errors import InputError
from balloon_warp.frame import Frame
from balloon_warp.frame_reader import FrameReader
from balloon_warp.garbage import without_collecting
from balloon_warp.kernels.laws import Law
from balloon_warp.model import Model, Vary, build_model, initial_state, overwrite, world_bytes
from balloon_warp.model.memory import require_memory
from balloon_warp.model.varied_scene import scene_to_vary
from balloon_warp.reading import Reading
from balloon_warp.scene import SceneLike
from balloon_warp.schedules.late_spheres import LateSpheres
from balloon_warp.solids import MassProperties, mass_properties
from balloon_warp.solvers.choose import solver_named
from balloon_warp.steering import Steered
from balloon_warp.turns import ALONE, taking_turns

if TYPE_CHECKING:
    from scipy.sparse.linalg import LinearOperator


class Simulator(Steered):
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

    _internal = (
        *("advance", "beginning", "diagnose", "drop_turns", "from_origin", "go_on_in", "go_on_with", "of_model"),
        *("schedule", "set_parameters", "step_unread", "take_due_turns"),
    )

    def __init__(
        self,
        scene: SceneLike,
        device: str | None = None,
        world_count: int = 1,
        vary: Vary | None = None,
        schedule: str = "auto",
        laws: Sequence[Law] = (),
    ):
        with ALONE:
            self._begin(build_model(scene_to_vary(scene, vary), pick_device(device), world_count, vary, laws), schedule)

    @classmethod
    def of_model(cls, model: Model, schedule: str = "auto") -> Self:
        """A simulator of a model that is laid out already.

        Raises:
            InputError: the worlds do not fit into the device's memory, or there is no such schedule.
        """
        simulator = cls.__new__(cls)
        with ALONE:
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
        self.frame_number, self._sets = 0, []
        self._forget_records()

    @taking_turns
    def reset(self) -> None:
        """Back to the start, as it was when the simulator was made: parameters and methods, too."""
        self._forget_records()
        del self.state, self.schedule  # their memory is wanted
        self._begin(*self._first)

    @property
    def beginning(self) -> Beginning:
        """What is simulated, where, and how."""
        model = self.model
        return Beginning(
            worlds=model.world_count,
            particles=model.world_count * model.particle_count,
            frames=model.scene.frames,
            substeps=model.substeps,
            frames_per_second=model.scene.frames_per_second,
            device=str(model.device),
            schedule=self.schedule.name,
        )

    @classmethod
    def from_origin(cls, origin: Origin) -> Self:
        """A simulator that goes on from a state that was kept."""
        simulator = cls.of_model(origin.model, origin.schedule)
        simulator.frame_number = origin.frame
        if origin.state:
            overwrite(simulator.state, origin.state)
        return simulator

    @taking_turns
    def _begin_step(self) -> None:
        self.take_due_turns()
        if self._origins.is_due(self.model, self.frame_number):
            model = replace(self.model, turns=list(self._turns))
            self._origins.keep(Origin(model, self._asked_schedule, self.frame_number, self.state))
        self.advance()

    @property
    def _waits(self) -> bool:
        return self._turn_is_due or self._origins.is_due(self.model, self.frame_number)

    @taking_turns
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

    @taking_turns
    def _begin_reading(self, world: int, net_forces: bool | None = None, buffer: int = 0) -> Reading:
        self._require_world(world)
        wanted = self.model.scene.net_forces if net_forces is None else net_forces
        return self._frame_reader.begin(self.state, self.frame_number, world, wanted, buffer)

    @taking_turns
    def mass_properties(self) -> MassProperties:
        """Volume, center of mass and inertia tensor of every balloon as a solid, in every world."""
        return mass_properties(self.model, self.state.points)

    def stiffness(self, world: int = 0, balloon: int = 0) -> "LinearOperator":
        """How stiffly a balloon holds its shape as it is now: minus the derivatives of the forces of its springs, film,
        pressure and gas by the places of its particles [N/m], a symmetric operator of scipy's, shape (3 n, 3 n).

        Raises:
            InputError: there is no such world or balloon.
        """
        from balloon_warp.statics.of_model import stiffness_operator  # scipy's sparse matrices are for who asks

        frame = self.read_frame(world)
        if not isinstance(balloon, int) or not 0 <= balloon < len(frame.points):
            raise InputError(f"balloon: there is no balloon {balloon}; expected 0 to {len(frame.points) - 1}")
        points = frame.points[balloon].astype(np.float64)
        return stiffness_operator(self.model, points, float(frame.pressures[balloon]), world, balloon)

    def _forget_records(self) -> None:
        """What was recorded or laid out for another schedule."""
        for cached in ("_frame_graph", "_frame_reader"):
            vars(self).pop(cached, None)

    @taking_turns
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

    @cached_property
    def _frame_reader(self) -> FrameReader:
        return FrameReader(self.model)

    @cached_property
    def _frame_graph(self) -> Any:
        """A frame, recorded once to be replayed without the cost of its launches."""
        with ALONE, wp.ScopedDevice(self.model.device), wp.ScopedCapture(self.model.device) as capture:
            self._advance_frame()
        return capture.graph

    def _advance_frame(self) -> None:
        self.schedule.advance_frame(self.state)
        self._late_spheres.hold(self.state)
