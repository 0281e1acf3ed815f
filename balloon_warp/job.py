"""Main job: simulate a scene, and write its stage, and a picture if requested."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from balloon_warp.arguments import checked
from balloon_warp.beginning import Beginning
from balloon_warp.blow_ups import MOST_HALVINGS, check_policy, with_half_the_step
from balloon_warp.errors import BlowUpError
from balloon_warp.inspection import Swelling, swellings_of, told_before
from balloon_warp.interrupts import Interrupts
from balloon_warp.kernels.laws import Law
from balloon_warp.model.remarks import remarks_in_sentences
from balloon_warp.model.strain_bound import StrainBound, overstretched_films
from balloon_warp.outcomes import BadEnding, bad_endings, ending_sentences
from balloon_warp.outputs.usd import StageWriter
from balloon_warp.outputs.wanted import Wanted
from balloon_warp.provenance import without_folders
from balloon_warp.resume import (
    CHECKPOINT_SECONDS,
    Checkpoints,
    RunOutput,
    describe_run,
    halvings_until,
    partial_path,
    record_frames,
)
from balloon_warp.scene import Scene, SceneLike, scene_of
from balloon_warp.schedules.contact_lists import overflow_remarks
from balloon_warp.simulator import Simulator


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
    on_begin: Callable[[Beginning], None] = lambda beginning: None,
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
    began = time.perf_counter()
    scene = scene_of(scene)
    check_policy(on_blowup)
    with Wanted.of(output, picture, save_points, lights, ground, view).checked(scene) as wanted:
        simulator, inflation = _begun(scene, device, schedule, laws, on_begin, on_warning)
        on_frame, again = told_before(inflation, on_note, on_frame), resume and on_blowup == "restart"
        restarts = halvings_until(partial_path(wanted.output), simulator.model.substeps) if again else 0
        for _ in range(restarts):
            scene = with_half_the_step(scene, simulator.model.substeps)
            simulator = Simulator(scene, device, schedule=schedule, laws=laws)
        while True:
            substeps = simulator.model.substeps  # at the start: the scene may change them
            try:
                begin, blow_up = _write(
                    simulator, wanted, provenance or {}, on_blowup, checkpoint_seconds, resume, on_frame, on_note
                )
                break
            except BlowUpError as failure:
                if on_blowup != "restart":
                    raise
                scene = _begun_again(scene, substeps, failure, restarts, on_warning)
                restarts, resume = restarts + 1, False
                simulator = Simulator(scene, device, schedule=schedule, laws=laws)
        seconds = time.perf_counter() - began
        endings = _look_at_the_end(simulator, blow_up, on_warning)
        wanted.draw(device)
    return _summary(simulator, name, wanted, begin, restarts, blow_up, endings, inflation, seconds)


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
    on_begin: Callable[[Beginning], None],
    on_warning: Callable[[str], None],
) -> tuple[Simulator, list[Swelling]]:
    """Make the simulator of a scene, tell its oddities, and how far its balloons swell by pressures left to us."""
    simulator = Simulator(scene, device, schedule=schedule, laws=laws)
    on_begin(Beginning.of(simulator.model, simulator.schedule.name))
    for warning in simulator.model.warnings:
        on_warning(warning)
    return simulator, swellings_of(simulator.model)


def _summary(
    simulator: Simulator,
    name: str,
    wanted: Wanted,
    begin: int,
    restarts: int,
    blow_up: BlowUpError | None,
    endings: list[BadEnding],
    inflation: list[Swelling],
    seconds: float,
) -> Summary:
    """Sum up a run of `animate`."""
    model, frames = simulator.model, simulator.frame_number - bool(blow_up)
    return Summary(
        output=str(wanted.output),
        picture=str(wanted.picture) if wanted.picture else None,
        points=str(wanted.points) if wanted.points else None,
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
    wanted: Wanted,
    provenance: Mapping[str, Any],
    on_blowup: str,
    checkpoint_seconds: float,
    resume: bool,
    on_frame: Callable[[int], None],
    on_note: Callable[[str], None],
) -> tuple[int, BlowUpError | None]:
    """Simulate all frames, write them into a stage, and make the wanted outputs of it.

    Returns the frame after which it began, and the blow-up that ended them early, where that is to leave a stage.
    """
    wanted.check_textures(simulator.model)
    blow_up, job, scene = None, describe_run(simulator) | wanted.left_out, simulator.model.scene
    said = {**provenance, **without_folders(job)}
    writer = StageWriter(wanted.stage, simulator.model, said, lights=wanted.lights, ground=wanted.ground)
    checkpoints = Checkpoints(
        *(partial_path(wanted.output), "run", job, scene), seconds=checkpoint_seconds, resume=resume, on_note=on_note
    )
    with writer as stage, Interrupts() as interrupts:
        wanted.check_names(stage.stage)
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
    wanted.export(on_note)
    checkpoints.remove()
    return begin, blow_up
