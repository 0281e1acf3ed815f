"""Files of a run: its stage, and room for what is made of it."""

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Self

from pxr import Usd

from balloon_warp.model import Model
from balloon_warp.scene import Scene
from balloon_warp.scene.load import files_of_scene
from balloon_warp.system.files import check_writable, require_no_inputs, sole_writer
from balloon_warp.usd import STAGE_SUFFIXES
from balloon_warp.usd.material import pictures_of


@dataclass
class RunFiles:
    """Stage of a run, which nobody else may write within the `with` block."""

    output: Path
    lights: bool = field(default=True, kw_only=True)
    """Whether the stage has lights, a backdrop and a camera"""
    ground: bool = field(default=True, kw_only=True)
    """Whether the stage has the scene's ground"""
    _files: ExitStack = field(default_factory=ExitStack, init=False)

    @property
    def left_out(self) -> dict[str, str]:
        """Names of the parts that the stage lacks, for its metadata."""
        lacking = [name for name in ("lights", "ground") if not getattr(self, name)]
        return {"leftOut": " ".join(lacking)} if lacking else {}

    @property
    def all(self) -> tuple[Path | None, ...]:
        """Files of a run but those of single frames; None for one that is not wanted."""
        return (self.output,)

    @property
    def stage(self) -> Path:
        """Path that the frames are written to."""
        return self.output

    @property
    def said(self) -> dict[str, str | None]:
        """Paths for a summary."""
        return {"output": str(self.output), "picture": None, "points": None}

    def checked(self, scene: Scene) -> Self:
        """Return the files, after checking that all can be written, and that none is a file of the scene.

        Raises:
            InputError: that is not so.
        """
        check_writable(self.output, STAGE_SUFFIXES)
        require_no_inputs(self.all, files_of_scene(scene))
        return self

    def check_textures(self, model: Model) -> None:
        """Make sure that no file is an image that a mesh of the model names.

        Raises:
            InputError: one is.
        """
        textures = [picture.file for picture in pictures_of([model]) if picture.file]
        require_no_inputs(self.all, dict.fromkeys(textures, "a texture of the scene's mesh"))

    def __enter__(self) -> Self:
        with ExitStack() as files:
            files.enter_context(sole_writer(*self.all))
            self._files = files.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._files.close()

    def check_names(self, stage: Usd.Stage) -> None:
        """Check what is to be made of the stage, whose frames are not there yet.

        Raises:
            InputError: it names a prim that the stage does not have.
        """

    def export(self, on_note: Callable[[str], None]) -> None:
        """Convert the written stage to further files.

        Raises:
            InputError: one cannot be written.
            KeyboardInterrupt: Ctrl-C; the message lists the files that are written.
        """

    def draw(self, device: str | None) -> None:
        """Make pictures of the stage.

        Raises:
            KeyboardInterrupt: Ctrl-C; the message lists the files that are written.
        """
