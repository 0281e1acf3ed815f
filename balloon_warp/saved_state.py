"""Saved state of a simulator: arrays of its state, and values set during the run."""

import json
from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from balloon_warp.model import State

CHANGES = "set"
"""Name of the saved settings: JSON, pairs of a frame and the values by their paths"""


def packed(state: State, changes: Sequence[tuple[int, Mapping[str, Any]]]) -> dict[str, NDArray]:
    """Copy a state to the host, with the values set until then.

    Args:
        changes: pairs of a frame and the values by their paths.
    """
    arrays = {name: np.array(array.numpy()) for name, array in state.arrays.items()}
    if changes:
        arrays[CHANGES] = np.array(json.dumps(changes))
    return arrays


def saved_changes(saved: Mapping[str, NDArray]) -> list[tuple[int, dict[str, Any]]]:
    """Find the values set before a simulator was saved, in order."""
    return json.loads(str(saved[CHANGES])) if CHANGES in saved else []


class Restored(Protocol):
    """A simulator at its start, into which a saved one is restored."""

    frame_number: int
    state: State
    controls: Any
    starts: Any

    def set(self, changes: Mapping[str, Any]) -> None: ...

    def make_due_changes(self) -> None: ...


def go_back_to(simulator: Restored, saved: Mapping[str, NDArray]) -> None:
    """Restore a simulator at its start to a saved one, with all values set until then."""
    simulator.starts.open_saved(saved)
    simulator.controls.open_saved(saved)
    for frame, changes in saved_changes(saved):
        simulator.frame_number = frame
        simulator.set(changes)
    simulator.frame_number = int(saved["frame"][0]) - 1
    simulator.make_due_changes()
    simulator.frame_number += 1
    fill_state(simulator.state, saved)
    simulator.controls.restore(saved)
    simulator.starts.restore(saved)


def fill_state(state: State, saved: Mapping[str, NDArray]) -> None:
    """Fill a state with the arrays that were saved of one like it."""
    for name, array in state.arrays.items():
        if array.size:  # state that the scene does not have may be missing from the checkpoint
            array.assign(saved[name])


def plain_values(changes: Mapping[str, Any]) -> dict[str, Any]:
    """Copy values that are set by their paths, NumPy's as those that JSON has."""
    return {
        path: value.tolist() if isinstance(value, np.ndarray | np.generic) else value for path, value in changes.items()
    }
