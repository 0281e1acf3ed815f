"""Controls: values of each world that somebody writes on the device, and the next frame reads."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, Protocol

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.kernels.frames.controlling import move_obstacles, read_control, write_control
from balloon_warp.kernels.laws.law import FAR
from balloon_warp.launching import launch
from balloon_warp.model import Model
from balloon_warp.model.rows import VELOCITY
from balloon_warp.shown import Shown
from balloon_warp.steering.control_plan import Beyond, ControlPlan, current_value, plan_control, with_reach
from balloon_warp.steering.given import copy_given
from balloon_warp.steering.views import columns_of, component

SAVED = "controls"
"""Beginning of the names of saved arrays"""


class Steered(Protocol):
    """A simulator, as controls know it."""

    model: Model

    def go_on_in(self, model: Model) -> None: ...


class Controls(Shown):
    """Device arrays by dotted paths of the scene: `simulator.controls["balloon.inflation.pressure"]`.

    Each has a row a world, shape (world_count,), or (world_count, 3) for a vector, float32. Torch, JAX, Warp and NumPy
    write them; every frame reads them as it begins, within its recorded graph. On the device a value beyond its bounds
    is clipped, or ends its world if that is asked. A value that is not finite ends its world always: the parameter
    stays as it was, and `faults` says so.
    """

    _internal = (
        *("begin_again", "column", "firsts", "follow", "move", "open_planned", "open_saved", "require_sound"),
        *("restore", "saved", "size", "write"),
    )

    def __init__(self, simulator: Steered):
        self._simulator = simulator
        self._plans: list[ControlPlan] = []
        self._values: dict[str, wp.array] = {}
        self._first: dict[str, wp.array] = {}
        self._places: wp.array | None = None
        model = simulator.model
        self.faults = wp.zeros(model.world_count, dtype=wp.int32, device=model.device)
        """Number of the control that ended each world, from 1 in the order of their opening; 0 if none has"""

    def __len__(self) -> int:
        return len(self._plans)

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __contains__(self, path: object) -> bool:
        return path in self._values

    def __getitem__(self, path: str) -> wp.array:
        return self._values[path] if path in self._values else self.open(path)

    def __setitem__(self, path: str, values: Any) -> None:
        copy_given(self[path], values, path)

    def __repr__(self) -> str:
        return f"Controls({', '.join(self._values) or 'none is open'})"

    def open(self, path: str, low: float | None = None, high: float | None = None, beyond: Beyond = "clip") -> wp.array:
        """Open a control, and return its array, which begins with the scene's present value.

        Kernels are made again for laws that may act from now on, and the step for the stiffest values within the
        bounds.

        Args:
            path: to a number or a vector of the scene, as in overrides.
            low: least value; the scene's own bound, when missing.
            high: largest value.
            beyond: "clip" values beyond the bounds, or "end" the world.

        Raises:
            InputError: there is no such path, its value cannot be written on the device, or the bounds are wrong.
        """
        if path in self._values:
            raise InputError(f"{path}: is already open")
        return self._open(plan_control(self._simulator.model, path, low, high, beyond))

    def open_planned(self, path: str, first: NDArray[np.float64], low: float, high: float) -> None:
        """Open a control that the scene's planned changes write.

        Args:
            first: numbers that it has as a world begins.

        Raises:
            InputError: its value cannot be written on the device.
        """
        plan = plan_control(self._simulator.model, path, low, high, "clip")
        self._open(replace(plan, planned=True))
        self._first[path].assign(np.broadcast_to(first if len(first) == 3 else first[0], self._first[path].shape))

    def _open(self, plan: ControlPlan) -> wp.array:
        model, path = self._simulator.model, plan.path
        moved = {VELOCITY, "obstacle_position"}
        if moved <= plan.names.union(*(each.names for each in self._plans)):
            raise InputError(f"{path}: controls move an obstacle either by position or by velocity")
        if taken := next((each for each in self._plans if _meet(each, plan)), None):
            raise InputError(f"{path}: is already written by the control {taken.path}")
        controlled = with_reach(model, [*self._plans, plan])
        self._plans.append(plan)
        self._values[path] = wp.array(current_value(model, plan), dtype=wp.float32, device=model.device)
        self._first[path] = wp.clone(self._values[path])
        if controlled.is_steered and self._places is None:
            self._places = wp.clone(controlled.parameters["obstacle_position"])
        self._simulator.go_on_in(controlled)
        return self._values[path]

    def size(self, path: str) -> int:
        """Return how many numbers of a world an open control has."""
        return int(np.prod(self._values[path].shape[1:], dtype=int))

    def column(self, path: str, axis: int) -> wp.array:
        """Return a number of an open control, shape (world_count,)."""
        return component(self._values[path], axis)

    def firsts(self) -> Iterator[tuple[wp.array, wp.array]]:
        """Yield values that worlds get back as they begin anew, from when a control was opened, and their arrays."""
        if self._places is not None:
            yield self._places, self._simulator.model.parameters["obstacle_position"]
        for path, values in self._values.items():
            yield self._first[path], values

    def begin_again(self) -> None:
        """Go on with the same arrays in a model that has just begun; they have the scene's values."""
        self.faults.zero_()
        if self._plans:
            self._simulator.go_on_in(with_reach(self._simulator.model, self._plans))
            self.follow()

    def follow(self) -> None:
        """Read the parameters, after the host has changed some."""
        model = self._simulator.model
        for plan in self._plans:
            for axis, places in enumerate(plan.places):
                name, index = places[0]
                source = columns_of(model.parameters[name], index)[0]
                values = component(self._values[plan.path], axis)
                launch(read_control, model.world_count, [source], [values], device=model.device)

    def saved(self) -> dict[str, NDArray]:
        """Copy all that is open to the host, as arrays by name."""
        if not self._plans:
            return {}
        told = [(plan.path, plan.low, plan.high, plan.beyond) for plan in self._plans]
        arrays = {f"{SAVED}.{path}": np.array(values.numpy()) for path, values in self._values.items()}
        if self._places is not None:
            arrays[f"{SAVED}_places"] = np.array(self._simulator.model.parameters["obstacle_position"].numpy())
        return {**arrays, f"{SAVED}_faults": np.array(self.faults.numpy()), SAVED: np.array(json.dumps(told))}

    def open_saved(self, saved: Mapping[str, NDArray]) -> None:
        """Open the controls that were open when a simulator was saved, and are not here."""
        for path, low, high, beyond in json.loads(str(saved[SAVED])) if SAVED in saved else ():
            if path not in self._values:
                self.open(path, low if low > -FAR else None, high if high < FAR else None, beyond)

    def restore(self, saved: Mapping[str, NDArray]) -> None:
        """Restore saved controls, in a simulator that has its state already."""
        if SAVED not in saved:
            return
        for path, values in self._values.items():
            if f"{SAVED}.{path}" in saved:
                values.assign(saved[f"{SAVED}.{path}"])
        if f"{SAVED}_places" in saved:
            self._simulator.model.parameters["obstacle_position"].assign(saved[f"{SAVED}_places"])
        self.write()
        self.faults.assign(saved[f"{SAVED}_faults"])

    def write(self) -> None:
        """Write all controls where the kernels read them, at the beginning of a frame."""
        model = self._simulator.model
        for number, plan in enumerate(self._plans, start=1):
            limits = [number, plan.low, plan.high, int(plan.beyond == "end")]
            for axis, places in enumerate(plan.places):
                values = component(self._values[plan.path], axis)
                for target in (
                    column for name, index in places for column in columns_of(model.parameters[name], index)
                ):
                    launch(
                        write_control,
                        model.world_count,
                        [values, *limits],
                        [target, self.faults],
                        device=model.device,
                    )

    def move(self) -> None:
        """Move obstacles on by the velocities of the frame that ends."""
        model = self._simulator.model
        if model.is_steered:
            positions, velocities = model.parameters["obstacle_position"], model.parameters[VELOCITY]
            inputs = [velocities, model.frame_seconds]
            launch(move_obstacles, positions.shape, inputs, [positions], device=model.device)

    def require_sound(self) -> None:
        """Make sure that no control has ended a world.

        Raises:
            InputError: names the first world, and the control.
        """
        faults = np.asarray(self.faults.numpy()) if self._plans else np.zeros(1)
        if faults.any():
            world = int(np.flatnonzero(faults)[0])
            plan = self._plans[int(faults[world]) - 1]
            value = np.asarray(self._values[plan.path].numpy())[world]
            limits = f" between {plan.low:g} and {plan.high:g}" if plan.beyond == "end" else ""
            raise InputError(f"{plan.path}: must be a finite number{limits}, in world {world} (got {value})")


def _meet(one: ControlPlan, other: ControlPlan) -> bool:
    """Return whether two controls write the same number."""

    def numbers(plan: ControlPlan) -> set[tuple[str, str]]:
        return {(name, str(index)) for each in plan.places for name, index in each}

    return not numbers(one).isdisjoint(numbers(other))
