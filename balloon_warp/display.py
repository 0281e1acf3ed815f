"""What a person sees of a simulator: a line of text, and in a notebook a picture."""

from abc import abstractmethod
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

from balloon_warp.errors import InputError
from balloon_warp.frame import Frame
from balloon_warp.model import Model, State, remark_sentences, remarks_on
from balloon_warp.outputs.snapshot import snapshot
from balloon_warp.shown import Shown
from balloon_warp.warp_lock import lock_of

NOTEBOOK_SIZE = (480, 270)
"""pixels"""


class Displayed(Shown):
    """The part of a simulator that shows what it is and where it is."""

    model: Model
    state: State
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
        """What is odd about the meshes, what became of it, and where numbers until now are not what was asked for, a
        sentence each."""
        return self.model.warnings + remark_sentences(remarks_on(self.model, self.state))

    def picture(self, world: int = 0, size: tuple[int, int] = (640, 360), samples: int = 4) -> bytes:
        """A picture of one world as it is now, as a PNG file has it: `Path("now.png").write_bytes(picture)`.

        Args:
            size: width and height in pixels.
            samples: rays a pixel.

        Raises:
            InputError: there is no such world, there is nothing finite to draw, or the size cannot be drawn.
        """
        return snapshot(self.model, self.read_frame(world), size, samples)

    def show(
        self,
        world: int = 0,
        *,
        folder: str | Path = ".",
        width: str = "100%",
        height: int = 640,
        origins: Sequence[str] = (),
    ) -> Any:
        """One world in the page of `balloon-warp view`, to play with: as the last line of a notebook's cell it is seen
        there, elsewhere its `address` says where to look. It begins where the world is now, in a simulation of its own,
        with the scene's values, and runs until it is closed: `shown.close()`.

        Args:
            folder: where recordings go.
            width: in the notebook, as CSS has it, such as "100%" or "800px".
            height: in pixels.
            origins: that the page may be shown from beside this machine, such as a proxy's: ["https://hub.example"].

        Raises:
            InputError: there is no such world, the folder is not there, or the page cannot be served.
            MissingExtraError: viser is not installed.
        """
        page = import_module("balloon_warp.viewer.notebook")  # which stands above, and loads when it is asked for
        model = self.model
        if not 0 <= world < model.world_count:
            raise InputError(f"world: {world}; expected 0 to {model.world_count - 1}")
        with lock_of(model.device):
            now = {name: array.numpy() for name, array in vars(self.state.of_world(world)).items()}
        return page.show(model.scene, "scene", str(model.device), model.own_laws, folder, (width, height), now, origins)

    def _repr_png_(self) -> bytes | None:
        """The first world, where there is something to be seen."""
        try:
            return self.picture(size=NOTEBOOK_SIZE)
        except InputError:
            return None

    def __repr__(self) -> str:
        return f"Simulator({self.model}, frame {self.frame_number}, {self.time:.3f} s)"
