"""Pictures of several stages through one camera, so that each difference between them is one of the scenes."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from balloon_warp.outputs.render.files import Picture
from balloon_warp.outputs.render.framing import frame_action
from balloon_warp.outputs.render.raycaster import RayCaster
from balloon_warp.outputs.render.render import LEAST_LINE_PIXELS
from balloon_warp.outputs.render.stage_reader import RenderStage


def render_alike(
    moments: Sequence[tuple[Path, int]], size: tuple[int, int], samples: int = 4, device: str | None = None
) -> Iterator[Picture]:
    """Return a picture of each stage, all through the camera that has everything of all of them in the picture.

    Args:
        moments: stages and the frame of each that is shown.
        size: width and height of a picture in pixels.
        samples: Rays per pixel.
        device: Warp device; the GPU, or else the CPU, if not given.

    Raises:
        InputError: a stage cannot be read, or there is nothing to draw.
    """
    stages = [(RenderStage(path), frame) for path, frame in moments]
    for stage, frame in stages:
        stage.read_prims(frame)
    framing = frame_action(stages, size[0] / size[1])
    pixel = framing.camera.pixel_size(framing.center, size[1])
    for stage, frame in stages:
        caster = RayCaster(stage, framing.center, framing.size, size, samples, device)
        caster.place(frame, 0.5 * LEAST_LINE_PIXELS * pixel)
        yield caster.picture(framing.camera)
