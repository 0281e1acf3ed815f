"""The main job: simulate a scene and write its stage, and a picture of it where one is asked for."""

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from balloon_warp.errors import InputError
from balloon_warp.outputs.files import check_writable
from balloon_warp.outputs.usd import STAGE_SUFFIXES, StageWriter
from balloon_warp.scene import Scene
from balloon_warp.simulator import Simulator


@dataclass(frozen=True)
class Summary:
    """What was done, how much, and how fast."""

    output: str
    """the stage that was written"""
    picture: str | None
    scene: str
    device: str
    schedule: str
    worlds: int
    particles: int
    """in one world"""
    springs: int
    """in one world"""
    frames: int
    substeps: int
    """in one frame"""
    wall_seconds: float
    """of simulating and writing, without the picture"""
    particle_substeps_per_second: float

    def as_json(self) -> dict[str, Any]:
        return asdict(self)


def animate(
    scene: Scene,
    output: str | Path,
    *,
    name: str = "",
    picture: str | Path | None = None,
    device: str | None = None,
    schedule: str = "auto",
    on_frame: Callable[[int], None] = lambda number: None,
    on_warning: Callable[[str], None] = lambda sentence: None,
) -> Summary:
    """Simulate a scene and write it.

    Args:
        scene: what to simulate.
        output: the stage to write; .usdc, .usda or .usd.
        name: what the summary calls the scene.
        picture: an image to render from the stage; .png, .gif or .mp4.
        device: a Warp device; the GPU where there is one, when missing.
        schedule: "scatter", "gather", "block", "lanes", "octets", or "auto" for the fastest.
        on_frame: told the number of each frame when it is written.
        on_warning: told what is odd about a mesh, in a sentence.

    Raises:
        InputError: the scene cannot be simulated or an output cannot be written; nothing is written then.
        BlowUpError: the simulation left the finite numbers; nothing is written then.
    """
    began = time.perf_counter()
    _check_outputs(scene, Path(output), Path(picture) if picture else None)
    simulator = Simulator(scene, device, schedule=schedule)
    for shape in simulator.model.shapes:
        for warning in shape.warnings:
            on_warning(warning)
    with StageWriter(output, simulator.model) as stage:
        for frame in simulator.run():
            stage.write(frame)
            on_frame(frame.number)
    seconds = time.perf_counter() - began
    if picture:
        from balloon_warp.outputs.render import render_stage

        render_stage(output, picture, device=device)
    model = simulator.model
    return Summary(
        output=str(output),
        picture=str(picture) if picture else None,
        scene=name,
        device=str(model.device),
        schedule=simulator.schedule.name,
        worlds=model.world_count,
        particles=model.particle_count,
        springs=model.spring_count,
        frames=scene.frames,
        substeps=model.substeps,
        wall_seconds=round(seconds, 3),
        particle_substeps_per_second=round(model.particle_count * model.substeps * scene.frames / seconds),
    )


def _check_outputs(scene: Scene, output: Path, picture: Path | None) -> None:
    """Before any work: that both files can be written, and that neither is a mesh of the scene."""
    check_writable(output, STAGE_SUFFIXES)
    if picture:
        from balloon_warp.outputs.render.files import PICTURE_SUFFIXES

        check_writable(picture, PICTURE_SUFFIXES)
    for balloon in scene.balloon:
        if isinstance(balloon.mesh, Path) and balloon.mesh.resolve() == output.resolve():
            raise InputError(f"{output}: is the mesh of the scene; expected another name for the stage, with -o")
