"""What changes in a simulator on its way: what its scene has planned, what somebody sets, and what was saved."""

import json
from abc import abstractmethod
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from balloon_warp.blow_ups import Origins
from balloon_warp.model import DueChange, Model, carry_over, fitting, initial_state
from balloon_warp.model.acting import acting_laws
from balloon_warp.model.gas import keep_pressures
from balloon_warp.model.setting import Setting, plan_setting
from balloon_warp.model.vary import METHODS
from balloon_warp.running import Running
from balloon_warp.schedules.late_spheres import LateSpheres
from balloon_warp.solvers.choose import solver_named
from balloon_warp.warp_lock import locked

SAVED_SETS = "set"
"""the name, among what is saved, of what was set: JSON, pairs of a frame and the values by their paths"""


class Steered(Running):
    """The part of a simulator whose parameters and methods may change between two frames."""

    _turns: deque[DueChange]
    _origins: Origins
    _first: tuple[Model, str]
    _asked_schedule: str
    _late_spheres: LateSpheres
    _sets: list[tuple[int, dict[str, Any]]]
    schedule: Any

    @abstractmethod
    def reset(self) -> None:
        """Back to the start."""

    @abstractmethod
    def _forget_records(self) -> None:
        """What was recorded or laid out for another schedule."""

    @locked
    def set(self, changes: Mapping[str, Any]) -> None:
        """Set values from now on, by their paths in the scene:
        {"balloon.mass": 3.0, "string.0.anchor": (0, 2, 0), "normals": "cached"}.

        A number may be given for each world, as an array of shape (world_count,), and a vector as one of shape
        (world_count, 3). A number takes the place of keyframes. Values are checked as those of a scene file, all of
        them before any is set. A step that is left to us becomes as long as they allow. What the scene has planned for
        later still happens.

        What a mesh is made into cannot change, nor how many things there are, nor what counts at the start alone, such
        as positions: `load_scene(scene, {...})` makes another scene of those.

        Raises:
            InputError: names the path that is not there, or cannot change, or has a value that cannot be; or the step,
                which the scene says, would be too long.
        """
        self.take_due_turns()
        setting = plan_setting(self.model, changes, self._turns, self.frame_number)
        self.go_on_with(setting)
        told = {path: value.tolist() if isinstance(value, np.ndarray | np.generic) else value
                for path, value in changes.items()}  # fmt: skip
        self._sets.append((self.frame_number, told))

    @locked
    def go_on_with(self, setting: Setting) -> None:
        """Go on with what is set."""
        acted, model = acting_laws(self.model), self.model
        if any(len(rows) > model.parameters[name].shape[0] for name, rows in setting.parameters.items()):
            model = model.with_rows_of_worlds()
            self.go_on_in(model)
        self.set_parameters(setting.parameters)
        methods_stay = all(getattr(setting.scene, name) == getattr(model.scene, name) for name in METHODS)
        model = replace(model, scene=setting.scene, substeps=setting.substeps)
        if methods_stay and setting.substeps == self.model.substeps and acting_laws(model) == acted:
            self.model = model
        else:
            self.go_on_in(model)

    @locked
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

    @locked
    def save(self) -> dict[str, NDArray]:
        """All that `restore` takes to go on from here, as arrays by name: `np.savez("here.npz", **simulator.save())`.
        Places and velocities of all worlds are `points` and `velocities`."""
        sets = {SAVED_SETS: np.array(json.dumps(self._sets))} if self._sets else {}
        return {name: np.array(array.numpy()) for name, array in vars(self.state).items()} | sets

    @locked
    def restore(self, saved: Mapping[str, NDArray]) -> None:
        """Go on, bit for bit, from where this simulator, or another one of the same scene, worlds and schedule, was
        when it was saved: what changed until then, of parameters and methods, is changed again.

        Args:
            saved: what `save` gave, or the file that it went into: `np.load("here.npz")`.
        """
        if self.frame_number or self._sets:
            self.reset()
        for frame, changes in json.loads(str(saved[SAVED_SETS])) if SAVED_SETS in saved else ():
            self.frame_number = frame
            self.set(changes)
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
        if turn.methods:
            methods = {name: getattr(turn.scene, name) for name in turn.methods}
            asked = methods.get("substeps", "auto")
            substeps = self.model.substeps if asked == "auto" else asked
            scene = self.model.scene.model_copy(update=methods)
            self.go_on_in(replace(self.model, scene=scene, substeps=substeps))
