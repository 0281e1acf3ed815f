"""Journal of the shares of a batch that are done, and of those that are saved."""

from pydantic import TypeAdapter

from balloon_warp.model import Remark
from balloon_warp.resume import Checkpoints, Part
from balloon_warp.sweep.blow_ups import Failures
from balloon_warp.sweep.output import BatchOutput
from balloon_warp.sweep.shares import ShareResult
from balloon_warp.sweep.task import BatchTask

FAILURES = TypeAdapter(Failures)
"""Conversion to JSON and back"""


class ShareJournal:
    """Puts shares into the output as they come, and those of an earlier batch first, where that is wanted.

    Args:
        task: of the batch.
        output: of the shares, in their order.
        checkpoints: where they are kept.
        device_kind: "cpu" or "cuda", on which the cut depends.

    Raises:
        InputError: as `Checkpoints.take_up`.
    """

    def __init__(self, task: BatchTask, output: BatchOutput, checkpoints: Checkpoints, device_kind: str):
        self._output, self._checkpoints = output, checkpoints
        self._frames = range(task.scene.frames + 1)
        self.schedules: dict[int, str] = {}
        """Schedules of the shares that are done, by their numbers"""
        self.failures = Failures()
        self.remarks: list[Remark] = []
        """Remarks on worlds of the shares that this batch has done"""
        self.overflow = 0
        """Contacts that were ignored in the shares that this batch has done, as schedules count them"""
        self._unsafe: list[int] = []
        self._unsafe_failures = Failures()
        for part in checkpoints.take_up(
            output,
            simulated=f"in {len(output.groups)} shares",
            device=device_kind,
            schedule=task.schedule,
        ):
            self.schedules.update(zip(part.groups, part.notes["schedules"], strict=True))
            self.failures.add(FAILURES.validate_python(part.notes["failures"]))
        self.resumed = sum(len(output.groups[number].worlds) for number in self.schedules) / task.world_count
        """Fraction of the worlds that an earlier batch had simulated"""
        if self.schedules:
            shares = f"{len(self.schedules)} of {len(output.groups)} shares"
            checkpoints.on_note(f"resuming with {shares} done, from {checkpoints.folder.path}")

    def add(self, number: int, result: ShareResult) -> None:
        """Add a share that is done."""
        for record in result.records:
            self._output.add(number, record)
        self.schedules[number] = result.schedule
        self.remarks += result.remarks
        self.overflow += result.overflow
        for failures in (self.failures, self._unsafe_failures):
            failures.add(result.failures)
        self._unsafe.append(number)

    def save(self) -> None:
        """Write a checkpoint of the shares that were done since the last, if there are any.

        Raises:
            InputError: it cannot be written; earlier files stay.
        """
        if self._unsafe:
            notes = {
                "schedules": [self.schedules[number] for number in self._unsafe],
                "failures": FAILURES.dump_python(self._unsafe_failures),
            }
            self._checkpoints.save_part(self._output, Part(self._frames, self._unsafe, notes))
            self._unsafe, self._unsafe_failures = [], Failures()
