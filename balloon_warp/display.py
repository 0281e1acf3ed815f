"""What a person sees of a simulator: a line of text, and in a notebook a picture."""

from abc import ABC, abstractmethod

from balloon_warp.errors import InputError
from balloon_warp.frame import Frame
from balloon_warp.model import Model
from balloon_warp.outputs.snapshot import snapshot

NOTEBOOK_SIZE = (480, 270)
"""pixels"""


class Displayed(ABC):
    """The part of a simulator that shows what it is and where it is."""

    model: Model
    frame_number: int

    @abstractmethod
    def read_frame(self, world: int = 0) -> Frame:
        """One world as it is now."""

    @property
    def time(self) -> float:
        """simulated since the start [s]"""
        return self.frame_number * self.model.frame_seconds

    @property
    def warnings(self) -> list[str]:
        """What is odd about the meshes, and what became of it, a sentence each."""
        return self.model.warnings

    def picture(self, world: int = 0, size: tuple[int, int] = (640, 360), samples: int = 4) -> bytes:
        """A picture of one world as it is now, as a PNG file has it: `Path("now.png").write_bytes(picture)`.

        Args:
            size: width and height in pixels.
            samples: rays a pixel.

        Raises:
            InputError: there is no such world, there is nothing finite to draw, or the size cannot be drawn.
        """
        return snapshot(self.model, self.read_frame(world), size, samples)

    def _repr_png_(self) -> bytes | None:
        """The first world, where there is something to be seen."""
        try:
            return self.picture(size=NOTEBOOK_SIZE)
        except InputError:
            return None

    def __repr__(self) -> str:
        return f"Simulator({self.model}, frame {self.frame_number}, {self.time:.3f} s)"
