"""The checkpoints of a run: its frames so far, and the state from which it goes on."""

import time
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any
from zipfile import BadZipFile

import numpy as np

from balloon_warp.blow_ups import MOST_HALVINGS
from balloon_warp.errors import InputError
from balloon_warp.files import target_of
from balloon_warp.outputs.npz import write_npz
from balloon_warp.provenance import describe_simulation
from balloon_warp.resume.folder import PartialFolder
from balloon_warp.resume.same_job import as_json, differences
from balloon_warp.simulator import Simulator
from balloon_warp.warp_lock import lock_of

if TYPE_CHECKING:
    from balloon_warp.outputs.usd import StageWriter

CHECKPOINT_SECONDS = 30.0
"""Time between two checkpoints [s]: the most that a kill costs"""
PLAYLIST, STILL = "frames.usda", "still.usdc"


def partial_path(output: Path) -> Path:
    """Name the folder of a run that is not finished, beside its output, or what links lead to from there."""
    target = target_of(output)
    return target.with_name(f"{target.name}.partial")


def halvings_until(folder: Path, substeps: int) -> int:
    """Return how often an unfinished run had restarted with half the step.

    Args:
        folder: Folder of its checkpoints.
        substeps: Original number of substeps; where no halving fits it, it is another run, and 0 is returned.
    """
    reached = (PartialFolder(folder).job() or {}).get("substeps")
    halves = [substeps * 2**halvings for halvings in range(MOST_HALVINGS + 1)]
    return halves.index(reached) if reached in halves else 0


def describe_run(simulator: Simulator) -> dict[str, Any]:
    """Describe what the bits of a run depend on, as JSON has it. Before the run: mesh files may change meanwhile."""
    model = simulator.model
    done_by = {
        "schedule": simulator.schedule.name,
        "device": model.device.name if model.device.is_cuda else "cpu",
    }
    return as_json(describe_simulation(model.scene, model.own_laws, model.substeps) | done_by)


class Checkpoints:
    """Keeps a run safe as it goes.

    A checkpoint is a stage of the frames since the last, `frames_BEGIN.usdc`, and then the state after them,
    `state_FRAME.npz`; `frames.usda` plays all of them.

    Args:
        simulator: at the start of the run, or where `resume` takes it.
        stage: that the frames are written to.
        job: what the bits of the run depend on, as of `describe_run`.
        seconds: between two checkpoints; 0 for none but the last of a run that is stopped.
        output: beside which the folder is; the stage, when missing.
    """

    def __init__(
        self,
        simulator: Simulator,
        stage: "StageWriter",
        job: Mapping[str, Any],
        seconds: float = CHECKPOINT_SECONDS,
        output: Path | None = None,
    ):
        self.simulator, self.stage, self.seconds = simulator, stage, seconds
        self.folder = PartialFolder(partial_path(output or stage.path))
        self._job, self._begun = job, False
        self._parts: list[int] = []
        """First frame of each part in the folder"""
        self._safe = 0
        """Number of frames in the folder"""
        self._saved_at = time.monotonic()

    @property
    def leftover(self) -> int | None:
        """The frame that an earlier run was saved at, of whatever scene; nothing where there is none."""
        frames = sorted(int(path.stem.removeprefix("state_")) for path in self.folder.path.glob("state_*.npz"))
        return frames[-1] if frames else None

    def resume(self) -> bool:
        """Go on from the last checkpoint, if there is one: frames into the stage, the state into the simulator.

        Raises:
            InputError: it is one of another run, or is damaged.
        """
        if (frame := self.leftover) is None:
            return False
        there = self.folder.job()
        if different := list(differences(there, self._job)):
            more = f" and {len(different) - 1} more" if len(different) > 1 else ""
            raise InputError(
                f"--resume: {self.folder.path} is of another run: {different[0]}{more}; expected the same "
                "scene, versions and device, or no --resume to start anew"
            )
        while self._safe <= frame:
            self._parts.append(self._safe)
            self._safe = self.stage.copy_frames(self._part(self._safe)) + 1
        state = self._state(frame)
        try:
            with np.load(state) as saved:
                self.simulator.restore(saved)
        except (OSError, ValueError, KeyError, BadZipFile) as error:
            raise InputError(f"{state}: cannot be read: {error}; expected a checkpoint") from None
        self.folder.go_on()
        self._begun = True
        return True

    @property
    def due(self) -> bool:
        """Return whether the last time is long ago."""
        return self.seconds > 0.0 and time.monotonic() - self._saved_at >= self.seconds

    def save(self) -> None:
        """Save all frames, which are written, and the state.

        Raises:
            InputError: the folder cannot be written to; what is in it stays.
        """
        from balloon_warp.outputs.usd.playlist import write_playlist  # loads USD, which a batch here may do without

        frame = self.simulator.frame_number
        if not self._begun:
            self.folder.begin(self._job)
            with self.stage.another(self.folder.path / STILL):
                self._begun = True  # and no frame
        if self._safe <= frame:
            self.stage.write_part(self._part(self._safe), range(self._safe, frame + 1))
            with self.folder.file(self._state(frame).name) as path, lock_of(self.simulator.model.device):
                write_npz(path, ((name, array.numpy()) for name, array in self.simulator.state.arrays.items()))
            for state in self.folder.path.glob("state_*.npz"):
                if state != self._state(frame):
                    state.unlink()
            self._parts.append(self._safe)
            self._safe = frame + 1
            with self.folder.file(PLAYLIST) as path:
                parts = [(begin, self._part(begin).name) for begin in self._parts]
                write_playlist(path, STILL, parts, frame, self.simulator.model.scene)
        self._saved_at = time.monotonic()

    def remove(self) -> None:
        """Remove the checkpoints once the whole output exists; leave those of an earlier run."""
        if self._begun:
            self.folder.remove()

    @property
    def playlist(self) -> Path:
        """The stage that plays all that is safe."""
        return self.folder.path / PLAYLIST

    def _part(self, begin: int) -> Path:
        return self.folder.path / f"frames_{begin:06d}.usdc"

    def _state(self, frame: int) -> Path:
        return self.folder.path / f"state_{frame:06d}.npz"
