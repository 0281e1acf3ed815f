"""How a simulator goes from frame to frame."""

from abc import abstractmethod
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from balloon_warp.blow_ups import BlowUp
from balloon_warp.display import Displayed
from balloon_warp.errors import BlowUpError, InputError
from balloon_warp.frame import Frame
from balloon_warp.kernels.measure.health import HEALTHY
from balloon_warp.model import State
from balloon_warp.reading import Reading
from balloon_warp.turns import taking_turns


class Running(Displayed):
    """The part of a simulator that steps and hands out frames."""

    state: State

    @abstractmethod
    def _begin_step(self) -> None:
        """Advance every world by one frame; a GPU goes on in the background."""

    @abstractmethod
    def _begin_reading(self, world: int, net_forces: bool | None = None, buffer: int = 0) -> Reading:
        """One world as it is now, on its way to the host. Two may be, into two buffers."""

    @property
    @abstractmethod
    def _waits(self) -> bool:
        """Whether the next frame may begin only once it is known that all went well in the last."""

    @abstractmethod
    def diagnose(self, world: int, frame: int, bad: int | None = None) -> BlowUp:
        """Why a world is bad that was found so after a frame."""

    def step(self, world: int = 0) -> Frame:
        """Advance every world by one frame, and hand one of them out: `frame = simulator.step()`.

        Raises:
            InputError: there is no such world; nothing is advanced then.
            BlowUpError: the simulation blew up.
        """
        self._require_world(world)
        self.step_unread()
        return self.read_frame(world)

    @taking_turns
    def step_unread(self) -> None:
        """Advance every world by one frame, of which nothing is read but whether all are well.

        Raises:
            BlowUpError: the simulation blew up.
        """
        self._begin_step()
        self._raise_if_bad(np.asarray(self.state.first_bad.numpy(), dtype=np.int32), self.frame_number)

    def relax(self, speed: float = 1.0e-3, most_seconds: float = 60.0, world: int = 0) -> Frame:
        """Go on until everything is at rest, and hand out that frame: what every shape that is called one waits for.

        Args:
            speed: no particle of any world is faster for a tenth of a second [m/s].
            most_seconds: simulated time after which it gives up.

        Raises:
            InputError: there is no such world, or something still moves then.
            BlowUpError: the simulation blew up.
        """
        self._require_world(world)
        if not speed > 0.0:
            raise InputError(f"speed: must be above 0 (got {speed})")
        rate = self.model.scene.frames_per_second
        calm, fastest = 0, np.inf
        for _ in range(int(np.ceil(most_seconds * rate))):
            self.step_unread()
            fastest = float(np.sqrt((np.asarray(self.state.velocities.numpy()) ** 2).sum(axis=-1).max(initial=0.0)))
            calm = calm + 1 if fastest <= speed else 0
            if calm > 0.1 * rate:
                return self.read_frame(world)
        raise InputError(
            f"relax: the fastest particle moves by {fastest:.3g} m/s after {most_seconds:g} s; expected at most "
            f"{speed:g}, which more damping or time may bring"
        )

    def _require_world(self, world: int) -> None:
        if not isinstance(world, int | np.integer) or not 0 <= world < self.model.world_count:
            raise InputError(f"world: there is no world {world}; expected 0 to {self.model.world_count - 1}")

    def run(self, world: int = 0, ahead: bool = False) -> Iterator[Frame]:
        """The frames of one world: the start, then as many as the scene asks for, one after the other.

        A simulator that is past its start gives the frames that are still missing.

        Args:
            ahead: whether the next frame is simulated while the loop works on this one, so that a GPU does not wait.
                For loops that look at the frames alone: the simulator itself is a frame further on.

        Raises:
            BlowUpError: the simulation blew up.
        """
        if self.frame_number == 0:
            yield self.read_frame(world)
        reading = None
        while reading or self._is_under_way:
            if reading and not (ahead and self._is_under_way and not self._waits):
                yield self._arrived(reading, world)
                reading = None
                continue
            self._begin_step()
            last, reading = reading, self._begin_reading(world, buffer=self.frame_number % 2)
            if last:
                yield self._arrived(last, world)

    @property
    def _is_under_way(self) -> bool:
        """Whether the scene asks for more frames."""
        return self.frame_number < self.model.scene.frames

    def _arrived(self, reading: Reading, world: int) -> Frame:
        """A frame that was read, if all worlds were well in it."""
        self._raise_if_bad(reading.first_bad(), reading.number)
        frame = reading.frame()
        if not frame.is_finite:
            raise BlowUpError(self.diagnose(world, frame.number))
        return frame

    def _raise_if_bad(self, first_bad: NDArray[np.int32], frame: int) -> None:
        if (first_bad != HEALTHY).any():
            world = int(np.argmax(first_bad != HEALTHY))
            raise BlowUpError(self.diagnose(world, frame, int(first_bad[world])))
