"""Main job: simulate a scene, write its stage and further files, and resume after a kill."""

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple, Self

from pxr import Usd

from balloon_warp.blow_ups import MOST_HALVINGS, check_policy, with_half_the_step
from balloon_warp.errors import BlowUpError
from balloon_warp.kernels.laws import Law
from balloon_warp.model import Model
from balloon_warp.model.plan import remarks_in_sentences
from balloon_warp.model.stability import StrainBound, overstretched_films
from balloon_warp.run.checkpoints import (
    CHECKPOINT_SECONDS,
    CheckpointOptions,
    Checkpoints,
    RunOutput,
    describe_run,
    halvings_until,
    partial_path,
    record_frames,
)
from balloon_warp.run.report import (
    BadEnding,
    RunHeader,
    Swelling,
    bad_endings,
    ending_sentences,
    swelling_sentences,
    swellings_of,
    without_folders,
)
from balloon_warp.scene import Scene, SceneLike, scene_of
from balloon_warp.scene.load import files_of_scene
from balloon_warp.schedules.touch_table import overflow_remarks
from balloon_warp.simulator import Simulator
from balloon_warp.system.files import check_writable, require_no_inputs, sole_writer
from balloon_warp.system.process import Interrupts
from balloon_warp.usd import STAGE_SUFFIXES, StageWriter
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
    def made(self) -> dict[str, str | None]:
        """Paths of the picture and the arrays, for a summary."""
        return {"picture": None, "points": None}

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
        """Check the further files against the stage, whose frames are not there yet.

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


def noting_before(
    found: Sequence[Swelling], on_note: Callable[[str], None], on_frame: Callable[[int], None]
) -> Callable[[int], None]:
    """Make a listener to frames that notes these before the first.

    Where no frame comes, something is wrong, and there is nothing to say but that.
    """
    waiting = swelling_sentences(found)

    def listen(number: int) -> None:
        while waiting:
            on_note(waiting.pop(0))
        on_frame(number)

    return listen


@dataclass(frozen=True)
class Summary:
    """Summary of a run: its output, amounts and speed."""

    output: str
    """Path of the output: a stage, or a file converted from one"""
    picture: str | None
    points: str | None
    """Path of the arrays beside the output, if requested"""
    scene: str
    device: str
    schedule: str
    worlds: int
    particles: int
    """Number of particles in one world"""
    springs: int
    """Number of springs in one world"""
    frames: int
    """Number of frames of the stage after the start"""
    begin: int
    """Frame at which the run started: 0, or a checkpoint's"""
    frames_per_second: float
    """Frame rate of the stage [1/s]"""
    substeps: int
    """Number of substeps in a frame"""
    restarts: int
    """Number of restarts after blow-ups, each with half the step"""
    blow_up: str | None
    """Reason why the frames end early"""
    bad_endings: list[BadEnding]
    """Balloons that came apart, fell forever, collapsed or folded over by the last frame"""
    inflation: list[Swelling]
    """Results of "auto" pressures"""
    strain_bound: StrainBound | None
    """Film that is softer than its material, if there is any"""
    wall_seconds: float
    """Duration of simulating and writing, without the picture [s]"""
    particle_substeps_per_second: float

    def as_json(self) -> dict[str, Any]:
        return asdict(self)


def run_scene(
    scene: SceneLike,
    files: RunFiles,
    *,
    name: str = "",
    device: str | None = None,
    schedule: str = "auto",
    on_blowup: str = "stop",
    laws: Sequence[Law] = (),
    provenance: Mapping[str, Any] | None = None,
    checkpoint_seconds: float = CHECKPOINT_SECONDS,
    resume: bool = False,
    on_begin: Callable[[RunHeader], None] = lambda header: None,
    on_frame: Callable[[int], None] = lambda number: None,
    on_note: Callable[[str], None] = lambda sentence: None,
    on_warning: Callable[[str], None] = lambda sentence: None,
) -> Summary:
    """Simulate a scene and write its files; arguments and errors are those of `balloon_warp.animate`.

    Args:
        files: Stage, and further files.
    """
    began = time.perf_counter()
    scene = scene_of(scene)
    check_policy(on_blowup)
    with files.checked(scene):
        simulator, inflation = _begun(scene, device, schedule, laws, on_begin, on_warning)
        on_frame, again = noting_before(inflation, on_note, on_frame), resume and on_blowup == "restart"
        checkpoints = CheckpointOptions(checkpoint_seconds, resume, on_note)
        restarts = halvings_until(partial_path(files.output), simulator.model.substeps) if again else 0
        for _ in range(restarts):
            scene = with_half_the_step(scene, simulator.model.substeps)
            simulator = Simulator(scene, device, schedule=schedule, laws=laws)
        while True:
            substeps = simulator.model.substeps  # at the start: the scene may change them
            try:
                begin, blow_up = _write(simulator, files, provenance or {}, on_blowup, checkpoints, on_frame)
                break
            except BlowUpError as failure:
                if on_blowup != "restart":
                    raise
                scene = _begun_again(scene, substeps, failure, restarts, on_warning)
                restarts, checkpoints = restarts + 1, replace(checkpoints, resume=False)
                simulator = Simulator(scene, device, schedule=schedule, laws=laws)
        written = _Written(begin, restarts, blow_up, time.perf_counter() - began)
        endings = _look_at_the_end(simulator, blow_up, on_warning)
        files.draw(device)
    return _summary(simulator, name, files, written, endings, inflation)


def _begun_again(
    scene: Scene, substeps: int, failure: BlowUpError, restarts: int, on_warning: Callable[[str], None]
) -> Scene:
    """Return the scene with half the step, once that is told.

    Raises:
        BlowUpError: it was halved often enough.
    """
    if restarts == MOST_HALVINGS:
        raise BlowUpError(f"{failure}. The {restarts} longer steps blew up as well") from None
    scene = with_half_the_step(scene, substeps)
    on_warning(f"{failure}. It restarts with {scene.substeps} substeps a frame")
    return scene


def _look_at_the_end(
    simulator: Simulator, blow_up: BlowUpError | None, on_warning: Callable[[str], None]
) -> list[BadEnding]:
    """Report bad endings of the balloons."""
    if blow_up:
        on_warning(f"{blow_up}. The stage ends at frame {simulator.frame_number - 1}, the last good one")
        return []
    last = simulator.read_frame(net_forces=False)
    endings = bad_endings(simulator.model, last)
    for sentence in ending_sentences(endings):
        on_warning(sentence)
    remarks = overstretched_films(simulator.model, last.points)
    remarks += remarks_in_sentences(simulator.model, simulator.state)
    for sentence in [*remarks, *overflow_remarks(simulator.schedule.overflow)]:
        on_warning(sentence)
    return endings


def _begun(
    scene: Scene,
    device: str | None,
    schedule: str,
    laws: Sequence[Law],
    on_begin: Callable[[RunHeader], None],
    on_warning: Callable[[str], None],
) -> tuple[Simulator, list[Swelling]]:
    """Make the simulator of a scene, tell its oddities, and how far its balloons swell by pressures left to us."""
    simulator = Simulator(scene, device, schedule=schedule, laws=laws)
    on_begin(RunHeader.of(simulator.model, simulator.schedule.name))
    for warning in simulator.model.warnings:
        on_warning(warning)
    return simulator, swellings_of(simulator.model)


class _Written(NamedTuple):
    """Stage of a run, as `Summary` describes it."""

    begin: int
    restarts: int
    blow_up: BlowUpError | None
    seconds: float


def _summary(
    simulator: Simulator,
    name: str,
    files: RunFiles,
    written: _Written,
    endings: list[BadEnding],
    inflation: list[Swelling],
) -> Summary:
    """Sum up a run of `animate`."""
    model, (begin, restarts, blow_up, seconds) = simulator.model, written
    frames = simulator.frame_number - bool(blow_up)
    return Summary(
        output=str(files.output),
        picture=files.made["picture"],
        points=files.made["points"],
        scene=name,
        device=str(model.device),
        schedule=simulator.schedule.name,
        worlds=model.world_count,
        particles=model.particle_count,
        springs=model.spring_count,
        frames=frames,
        frames_per_second=model.scene.frames_per_second,
        begin=begin,
        substeps=model.substeps,
        restarts=restarts,
        blow_up=str(blow_up) if blow_up else None,
        bad_endings=endings,
        inflation=inflation,
        strain_bound=simulator.model.strain_bound,
        wall_seconds=round(seconds, 3),
        particle_substeps_per_second=round(model.particle_count * model.substeps * (frames - begin) / seconds),
    )


def _write(
    simulator: Simulator,
    files: RunFiles,
    provenance: Mapping[str, Any],
    on_blowup: str,
    options: CheckpointOptions,
    on_frame: Callable[[int], None],
) -> tuple[int, BlowUpError | None]:
    """Simulate all frames, write them into a stage, and make the wanted outputs of it.

    Returns the frame after which it began, and the blow-up that ended them early, where that is to leave a stage.
    """
    files.check_textures(simulator.model)
    blow_up, job, scene = None, describe_run(simulator) | files.left_out, simulator.model.scene
    said = {**provenance, **without_folders(job)}
    writer = StageWriter(files.stage, simulator.model, said, lights=files.lights, ground=files.ground)
    checkpoints = Checkpoints(partial_path(files.output), "run", job, scene, options)
    with writer as stage, Interrupts() as interrupts:
        files.check_names(stage.stage)
        output = RunOutput(stage)
        missing = max((part.frames.stop for part in checkpoints.take_up(output)), default=0)
        checkpoints.restore(missing, [simulator.restore])
        begin = simulator.frame_number
        on_frame(begin)
        frames = ((frame.number, frame) for frame in simulator.run())
        try:
            record_frames(frames, output, checkpoints, [lambda: simulator.save().items()], interrupts, on_frame)
        except BlowUpError as failure:
            if on_blowup == "restart":
                checkpoints.remove()  # of another step
            if on_blowup != "freeze":
                raise
            blow_up = failure
    files.export(options.on_note)
    checkpoints.remove()
    return begin, blow_up
