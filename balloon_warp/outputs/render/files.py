"""Picture files: PNG for one frame, WebP, GIF and MP4 for many."""

from collections.abc import Callable, Iterable
from importlib import import_module
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from balloon_warp.errors import MissingExtraError
from balloon_warp.marks import png_mark

PICTURE_SUFFIXES = (".png", ".webp", ".gif", ".mp4")
DITHER = 6.0
"""8-bit steps that a color is moved by, at most half of it up or down, before it gets the palette's nearest"""
WEBP_QUALITY = 82
"""Quality, out of 100: 640x360 pixels of a balloon take some 10 kB a frame"""
GIF_LONGEST = 655_350
"""Longest time that a GIF can show a picture for [ms]"""
Picture = NDArray[np.uint8]
"""Picture in sRGB, shape (height, width, 3), or with opacity (height, width, 4)"""
_BAYER = (np.array([[0, 8, 2, 10], [12, 4, 14, 6], [3, 11, 1, 9], [15, 7, 13, 5]]) + 0.5) / 16.0


def write_png(path: Path, picture: Picture) -> None:
    """Write one picture."""
    Image.fromarray(picture).save(path, format="PNG", optimize=True, pnginfo=png_mark())


def write_gif(path: Path, pictures: Iterable[Picture], frame_seconds: float) -> None:
    """Write an endless animation with one palette; GIF counts time in hundredths of a second."""
    pictures = list(pictures)
    palette = _common_palette(pictures)
    first, *others = [_dithered(picture, palette) for picture in pictures]
    first.save(
        path,
        format="GIF",
        save_all=True,
        append_images=others,
        duration=min(round(1000 * frame_seconds), GIF_LONGEST),
        loop=0,
        optimize=False,
    )


def write_webp(path: Path, pictures: Iterable[Picture], frame_seconds: float) -> None:
    """Write an endless animation, or one picture, with all of its colors."""
    first, *others = map(Image.fromarray, pictures)
    milliseconds = max(1, round(1000 * frame_seconds))
    many = {"save_all": True, "append_images": others, "duration": milliseconds, "loop": 0} if others else {}
    first.save(path, format="WEBP", quality=WEBP_QUALITY, method=4, **many)


def _common_palette(pictures: list[Picture]) -> Image.Image:
    """Return 255 colors for all pictures, from every fourth pixel each way of a dozen of them."""
    some = pictures[:: max(1, len(pictures) // 12)]
    mosaic = np.concatenate([picture[::4, ::4] for picture in some])
    return Image.fromarray(mosaic).quantize(255, method=Image.Quantize.MEDIANCUT, kmeans=2)


def _dithered(picture: Picture, palette: Image.Image) -> Image.Image:
    """Return a picture in a palette's colors.

    Ordered dither, unlike error diffusion, leaves unmoved pixels alone.
    """
    rows, columns = np.indices(picture.shape[:2]) % len(_BAYER)
    shifted = picture + DITHER * (_BAYER[rows, columns, None] - 0.5)
    return Image.fromarray(shifted.clip(0, 255).astype(np.uint8)).quantize(palette=palette, dither=Image.Dither.NONE)


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


def require_ffmpeg() -> Callable:
    """Return imageio-ffmpeg's writer.

    Raises:
        MissingExtraError: imageio-ffmpeg is not installed.
    """
    try:
        return import_module("imageio_ffmpeg").write_frames
    except ImportError:
        raise MissingExtraError("an .mp4 needs ffmpeg: pip install 'balloon-warp[video]'") from None
