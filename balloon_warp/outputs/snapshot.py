"""A picture of a frame that is in no stage yet."""

from balloon_warp.errors import InputError
from balloon_warp.files import scratch_folder
from balloon_warp.frame import Frame
from balloon_warp.model import Model

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
    from balloon_warp.outputs.render import render_stage
    from balloon_warp.outputs.usd import StageWriter

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
