"""The main job with all its outputs: a stage, files converted from it, and pictures."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

from pxr import Usd

from balloon_warp.errors import InputError
from balloon_warp.frame import Frame
from balloon_warp.kernels.laws import Law
from balloon_warp.model import Model
from balloon_warp.run.checkpoints import CHECKPOINT_SECONDS
from balloon_warp.run.job import RunFiles, Summary, run_scene
from balloon_warp.run.report import RunHeader
from balloon_warp.scene import Scene, SceneLike
from balloon_warp.scene.load import files_of_scene
from balloon_warp.studio.export import HDF5_SUFFIXES, check_export, export_stage, files_of_frames
from balloon_warp.system.api import checked
from balloon_warp.system.files import (
    check_writable,
    folder_beside,
    require_no_inputs,
    require_ours,
    scratch_folder,
    sole_writer,
)
from balloon_warp.usd import STAGE_SUFFIXES

NOTEBOOK_SIZE = (480, 270)
"""Size of a picture that a notebook shows by itself [pixels]"""


def snapshot(model: Model, frame: Frame, size: tuple[int, int], samples: int) -> bytes:
    """Draw the frame as a PNG file has it, seen as `render_stage` sees it.

    Args:
        size: Width and height in pixels.
        samples: Rays per pixel.

    Raises:
        InputError: the frame is not finite, or the size cannot be drawn.
    """
    if not frame.is_finite:
        raise InputError(f"frame {frame.number}: has positions that are not finite; expected finite ones to draw")
    # only who looks waits for USD and Pillow
    from balloon_warp.studio.render import render_stage
    from balloon_warp.usd import StageWriter

    with scratch_folder() as folder:
        stage, picture = folder / "frame.usdc", folder / "frame.png"
        with StageWriter(stage, model) as writer:
            writer.write(frame)
        render_stage(stage, picture, frame.number, size, samples, str(model.device))
        return picture.read_bytes()


def notebook_picture(model: Model, frame: Frame) -> bytes | None:
    """Draw the frame for a notebook; None where there is nothing to be seen."""
    try:
        return snapshot(model, frame, NOTEBOOK_SIZE, samples=4)
    except InputError:
        return None


@dataclass
class RequestedOutputs(RunFiles):
    """Stage of a run, and files that are made from it.

    The stage is the output itself, or, where that is of another kind, in a hidden folder beside it, which is removed at
    the end of the `with` block.
    """

    picture: Path | None = None
    """Picture of the stage"""
    points: Path | None = None
    """Arrays of the stage's points and measures"""
    view: Mapping[str, Any] = field(default_factory=dict)
    """Options of `render_stage` for the picture"""
    _folder: Path | None = field(default=None, init=False)

    @property
    def all(self) -> tuple[Path | None, ...]:
        return self.output, self.picture, self.points

    @property
    def made(self) -> dict[str, str | None]:
        named = {"picture": self.picture, "points": self.points}
        return {name: str(path) if path else None for name, path in named.items()}

    @property
    def is_stage(self) -> bool:
        """Return whether the output is a stage."""
        return self.output.suffix.lower() in STAGE_SUFFIXES

    @property
    def stage(self) -> Path:
        return self.output if self._folder is None else self._folder / "frames.usdc"

    def checked(self, scene: Scene) -> Self:
        check_export(self.output)
        if self.picture:
            from balloon_warp.studio.render.render import PICTURE_SUFFIXES
            from balloon_warp.studio.render.view import check_view

            check_writable(self.picture, PICTURE_SUFFIXES)
            check_view(self.picture, **self.view)
        if self.points:
            if self.points.suffix.lower() not in HDF5_SUFFIXES:
                raise InputError(f"{self.points}: cannot hold points; expected {' or '.join(HDF5_SUFFIXES)}")
            check_export(self.points)
        of_frames = files_of_frames(self.output, range(scene.frames + 1))
        for path in of_frames:
            require_ours(path)
        require_no_inputs([*self.all, *of_frames], files_of_scene(scene))
        return self

    def check_names(self, stage: Usd.Stage) -> None:
        if self.picture:
            from balloon_warp.studio.render.view import check_view

            check_view(self.picture, **self.view).check_names(stage, self.output)

    def __enter__(self) -> Self:
        with ExitStack() as files:
            files.enter_context(sole_writer(*self.all))
            if not self.is_stage:
                self._folder = files.enter_context(folder_beside(self.output))
            self._files = files.pop_all()
        return self

    def export(self, on_note: Callable[[str], None]) -> None:
        if not self.is_stage:
            self._make(self.output, lambda: export_stage(self.stage, self.output, on_note=on_note))
        if self.points:
            points = self.points
            self._make(points, lambda: export_stage(self.stage, points, on_note=on_note))

    def draw(self, device: str | None) -> None:
        if self.picture:
            from balloon_warp.studio.render import render_stage

            picture = self.picture
            self._make(picture, lambda: render_stage(self.stage, picture, device=device, **self.view))

    def _make(self, path: Path, make: Callable[[], Any]) -> None:
        try:
            make()
        except KeyboardInterrupt:
            there = f"{self.output} is written, {path} is not" if path != self.output else f"{path} is not written"
            raise KeyboardInterrupt(there) from None


@checked
def animate(
    scene: SceneLike,
    output: str | Path,
    *,
    name: str = "",
    picture: str | Path | None = None,
    save_points: str | Path | None = None,
    lights: bool = True,
    ground: bool = True,
    device: str | None = None,
    schedule: str = "auto",
    on_blowup: str = "stop",
    laws: Sequence[Law] = (),
    provenance: Mapping[str, Any] | None = None,
    checkpoint_seconds: float = CHECKPOINT_SECONDS,
    resume: bool = False,
    view: Mapping[str, Any] | None = None,
    on_begin: Callable[[RunHeader], None] = lambda header: None,
    on_frame: Callable[[int], None] = lambda number: None,
    on_note: Callable[[str], None] = lambda sentence: None,
    on_warning: Callable[[str], None] = lambda sentence: None,
) -> Summary:
    """Simulate a scene and write its motion: as USD, or as another kind of file.

    A long run writes checkpoints to the folder `OUTPUT.partial` beside the output. So it can resume after a kill or
    Ctrl-C. The folder is removed once the output is there. A failure leaves the old stage.

    Args:
        scene: Scene, or a source that `load_scene` takes.
        output: File to write: a stage, .usdc, .usda or .usd; or a kind that `export_stage` writes, such as .glb.
        name: Name of the scene in the summary.
        picture, view: Image of the stage, .png, .webp, .gif or .mp4, and its camera, such as {"azimuth": 180.0}.
        save_points: Further file to write, .h5, with the points as arrays.
        lights, ground: Whether the stage has lights, a backdrop and a camera, and the scene's ground.
        device: Warp device; the GPU, or else the CPU, if not given.
        schedule: Parallel schedule: "scatter", "gather", "block", "lanes", "octets", or "auto" for the fastest.
        on_blowup: Action when the run blows up: "stop" raises; "freeze" ends the stage at its last good frame;
            "restart" begins again with half the step, at most `MOST_HALVINGS` times.
        laws: User-defined laws beside the built-in ones; see `balloon_warp.laws`.
        provenance: Further provenance for the stage's `customLayerData`, such as a command, beside
            the scene, the hashes of meshes and laws, versions, device, schedule and substeps.
        checkpoint_seconds: Interval between checkpoints; 0 for one only when the run is stopped.
        resume: Go on from the last checkpoint, if there is one, to the same bytes as a run that was never stopped.
        on_begin, on_frame: Called with a summary of the run, once, and with the number of each simulated frame.
        on_note: Called with sentences: where the run begins, and whether an earlier one was not finished.
        on_warning: Called with sentences on defects of a mesh, strings that start overstretched, spheres that may come
            through, a blow-up that does not stop the run, and bad endings.

    Raises:
        InputError: the scene cannot be simulated, an output cannot be written, or a checkpoint is another run's.
        BlowUpError: the simulation blew up with "stop", or after the last restart.
        KeyboardInterrupt: Ctrl-C, after the frame and the checkpoint; the message says how to go on.
    """
    wanted = RequestedOutputs(
        Path(output),
        *(Path(path) if path else None for path in (picture, save_points)),
        view=view or {},
        lights=lights,
        ground=ground,
    )
    return run_scene(
        scene,
        wanted,
        name=name,
        device=device,
        schedule=schedule,
        on_blowup=on_blowup,
        laws=laws,
        provenance=provenance,
        checkpoint_seconds=checkpoint_seconds,
        resume=resume,
        on_begin=on_begin,
        on_frame=on_frame,
        on_note=on_note,
        on_warning=on_warning,
    )
