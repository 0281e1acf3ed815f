"""Picture files: PNG for one frame, GIF and MP4 for many."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from balloon_warp.errors import MissingExtraError

PICTURE_SUFFIXES = (".png", ".gif", ".mp4")
Picture = NDArray[np.uint8]
"""sRGB, shape (height, width, 3)"""


def write_png(path: Path, picture: Picture) -> None:
    """Write one picture."""
    Image.fromarray(picture).save(path, format="PNG", optimize=True)


def write_gif(path: Path, pictures: Iterable[Picture], frame_seconds: float) -> None:
    """Write an endless animation; GIF counts time in hundredths of a second."""
    palette: Image.Image | None = None
    frames = []
    for picture in pictures:
        palette = palette or Image.fromarray(picture).quantize(255, method=Image.Quantize.MEDIANCUT)
        frames.append(_with_palette(picture, palette))
    frames[0].save(
        path, format="GIF", save_all=True, append_images=frames[1:], duration=round(1000 * frame_seconds), loop=0
    )


def _with_palette(picture: Picture, palette: Image.Image) -> Image.Image:
    """The nearest colors of a palette, with ordered dither: unlike error diffusion it leaves still parts still."""
    return Image.fromarray(picture).quantize(palette=palette, dither=Image.Dither.NONE)


def write_mp4(path: Path, pictures: Iterable[Picture], frames_per_second: float) -> None:
    """Write H.264.

    Raises:
        MissingExtraError: imageio-ffmpeg is not installed.
    """
    write_frames = require_ffmpeg()
    pictures = iter(pictures)
    first = next(pictures)
    height, width = first.shape[:2]
    writer = write_frames(
        str(path), (width, height), fps=frames_per_second, codec="libx264", quality=8, macro_block_size=2
    )
    writer.send(None)
    writer.send(first)
    for picture in pictures:
        writer.send(picture)
    writer.close()


def require_ffmpeg():
    """imageio-ffmpeg's writer.

    Raises:
        MissingExtraError: imageio-ffmpeg is not installed.
    """
    try:
        from imageio_ffmpeg import write_frames
    except ImportError:
        raise MissingExtraError("an .mp4 needs ffmpeg: pip install 'balloon-warp[video]'") from None
    return write_frames
