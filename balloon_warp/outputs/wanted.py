"""Outputs that a run is to write: a stage, files converted from it, and a picture."""

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from pxr import Usd

from balloon_warp.errors import InputError
from balloon_warp.files import check_writable, folder_beside, require_no_inputs, require_ours, sole_writer
from balloon_warp.model import Model
from balloon_warp.outputs.exports import HDF5_SUFFIXES, check_export, export_stage, files_of_frames
from balloon_warp.outputs.usd import STAGE_SUFFIXES
from balloon_warp.outputs.usd.material import pictures_of
from balloon_warp.scene import Scene
from balloon_warp.scene.load import files_of_scene


@dataclass
class Wanted:
    """Outputs of a run, and within the `with` block, in which nobody else may write them, the place of the stage.

    The place is the output itself, or, where that is of another kind, a hidden folder beside it, which is removed at
    the block's end.
    """

    output: Path
    """Stage, or a file converted from one"""
    picture: Path | None = None
    """Picture of the stage"""
    points: Path | None = None
    """Arrays of the stage's points and measures"""
    lights: bool = True
    """Whether the stage has lights, a backdrop and a camera"""
    ground: bool = True
    """Whether the stage has the scene's ground"""
    view: Mapping[str, Any] = field(default_factory=dict)
    """Options of `render_stage` for the picture"""
    _files: ExitStack = field(default_factory=ExitStack, init=False)
    _folder: Path | None = field(default=None, init=False)

    @classmethod
    def of(
        cls,
        output: str | Path,
        picture: str | Path | None = None,
        points: str | Path | None = None,
        lights: bool = True,
        ground: bool = True,
        view: Mapping[str, Any] | None = None,
    ) -> Self:
        """Return the wanted outputs, with files as text or paths."""
        others = (Path(path) if path else None for path in (picture, points))
        return cls(Path(output), *others, lights=lights, ground=ground, view=view or {})

    @property
    def left_out(self) -> dict[str, str]:
        """Names of the parts that the stage lacks, for its metadata."""
        lacking = [name for name in ("lights", "ground") if not getattr(self, name)]
        return {"leftOut": " ".join(lacking)} if lacking else {}

    @property
    def _all(self) -> tuple[Path | None, ...]:
        return self.output, self.picture, self.points

    @property
    def is_stage(self) -> bool:
        """Return whether the output is a stage."""
        return self.output.suffix.lower() in STAGE_SUFFIXES

    @property
    def stage(self) -> Path:
        """Path that the frames are written to."""
        return self.output if self._folder is None else self._folder / "frames.usdc"

    def checked(self, scene: Scene) -> Self:
        """Return the outputs, after checking that all files can be written, and that none is a file of the scene.

        Raises:
            InputError: that is not so.
            MissingExtraError: the package that writes one is not installed.
        """
        check_export(self.output)
        if self.picture:
            from balloon_warp.outputs.render.render import PICTURE_SUFFIXES
            from balloon_warp.outputs.render.view import check_view

            check_writable(self.picture, PICTURE_SUFFIXES)
            check_view(self.picture, **self.view)
        if self.points:
            if self.points.suffix.lower() not in HDF5_SUFFIXES:
                raise InputError(f"{self.points}: cannot hold points; expected {' or '.join(HDF5_SUFFIXES)}")
            check_export(self.points)
        of_frames = files_of_frames(self.output, range(scene.frames + 1))
        for path in of_frames:
            require_ours(path)
        require_no_inputs([*self._all, *of_frames], files_of_scene(scene))
        return self

    def check_textures(self, model: Model) -> None:
        """Make sure that no output is an image that a mesh of the model names.

        Raises:
            InputError: one is.
        """
        textures = [picture.file for picture in pictures_of([model]) if picture.file]
        require_no_inputs(self._all, dict.fromkeys(textures, "a texture of the scene's mesh"))

    def check_names(self, stage: Usd.Stage) -> None:
        """Check the picture's names of prims.

        Raises:
            InputError: The picture is to show a prim that the stage, whose frames are not there yet, does not have.
        """
        if self.picture:
            from balloon_warp.outputs.render.view import check_view

            check_view(self.picture, **self.view).check_names(stage, self.output)

    def __enter__(self) -> Self:
        with ExitStack() as files:
            files.enter_context(sole_writer(*self._all))
            if not self.is_stage:
                self._folder = files.enter_context(folder_beside(self.output))
            self._files = files.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._files.close()

    def export(self, on_note: Callable[[str], None]) -> None:
        """Convert the written stage to the wanted files.

        Raises:
            InputError: it cannot be written.
            KeyboardInterrupt: Ctrl-C; the message lists the files that are written.
        """
        if not self.is_stage:
            self._make(self.output, lambda: export_stage(self.stage, self.output, on_note=on_note))
        if self.points:
            points = self.points
            self._make(points, lambda: export_stage(self.stage, points, on_note=on_note))

    def draw(self, device: str | None) -> None:
        """Make the picture of the stage, if one is wanted.

        Raises:
            KeyboardInterrupt: Ctrl-C; the message lists the files that are written.
        """
        if self.picture:
            from balloon_warp.outputs.render import render_stage

            picture = self.picture
            self._make(picture, lambda: render_stage(self.stage, picture, device=device, **self.view))

    def _make(self, path: Path, make: Callable[[], Any]) -> None:
        try:
            make()
        except KeyboardInterrupt:
            there = f"{self.output} is written, {path} is not" if path != self.output else f"{path} is not written"
            raise KeyboardInterrupt(there) from None
