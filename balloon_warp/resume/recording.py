"""Frames of a job, written while the next ones are simulated, and kept safe."""

from collections.abc import Callable, Iterable, Sequence
from typing import Protocol, TypeVar

from numpy.typing import NDArray

from balloon_warp.interrupts import Interrupts
from balloon_warp.outputs.background import Background
from balloon_warp.resume.checkpoints import Checkpoints
from balloon_warp.resume.part import Output, Part

Simulated = TypeVar("Simulated", contravariant=True)
State = Iterable[tuple[str, NDArray]]
"""Arrays by name"""


class FrameOutput(Output, Protocol[Simulated]):
    """Output that takes frames as they come."""

    def write(self, frame: Simulated, /) -> None:
        """Write the next frame."""


def record_frames(
    frames: Iterable[tuple[int, Simulated]],
    output: FrameOutput[Simulated],
    checkpoints: Checkpoints,
    states: Sequence[Callable[[], State]],
    interrupts: Interrupts,
    on_frame: Callable[[int], None],
) -> None:
    """Write frames, on a thread of their own, and a checkpoint when one is due or the job is stopped.

    Args:
        frames: numbers and simulated frames for the output, as they come.
        states: Functions that return the state of each group after the last frame.
        interrupts: that stop the job, after a frame and its checkpoint.
        on_frame: Called with the number of each simulated frame.

    Raises:
        InputError: something cannot be written.
        KeyboardInterrupt: the job was stopped; the message says how to go on.
    """
    saved: int | None = None
    with Background() as writer:
        for number, frame in frames:
            saved = number if saved is None else saved
            writer.submit(output.write, frame)
            on_frame(number)
            if checkpoints.due or interrupts.pending:
                for group, state in enumerate(states):
                    checkpoints.save_state(number, group, state())
                writer.submit(checkpoints.save_part, output, Part(range(saved, number + 1), range(len(states))))
                saved = number + 1
            if interrupts.pending:
                writer.wait()
                interrupts.deliver(checkpoints.advice)
