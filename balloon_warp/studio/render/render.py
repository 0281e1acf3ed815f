"""Rendering of a stage, or of several alike, as a picture file."""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from balloon_warp.errors import InputError, MissingExtraError
from balloon_warp.studio.render.raycaster import RayCaster
from balloon_warp.studio.render.stage_reader import RenderStage
from balloon_warp.studio.render.timing import moments, one_over_the_other
from balloon_warp.studio.render.view import View, check_view, frame_action
from balloon_warp.system.arguments import checked
from balloon_warp.system.files import check_writable, png_mark, sole_writer, whole_file
from balloon_warp.usd.studio import Camera

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


MOST_RATE = {".gif": 20.0, ".webp": 30.0}
"""Largest frame rate of such an animation, unless a rate is asked for [1/s]"""
MOST_PICTURES = 120
"""Largest number of pictures of such an animation"""
MOST_FRAMES = 1_000_000
"""Largest number of frames in the time that an animation shows"""
FRAMES_PER_SECOND = (0.01, 1_000.0)
"""Range of the frame rate of a stage that an animation is made of [1/s]"""
MOST_PIXELS = 8_192
"""Largest side of a picture [pixels]: one of this width and height takes about 9 GB of memory while it is made"""
MOST_SAMPLES = 4_096
LEAST_LINE_PIXELS = 1.3
"""Least width of lines in the middle of the action [pixels], or they would break up"""


@dataclass(frozen=True)
class Film:
    """Film of a picture: size, samples and exposure."""

    size: tuple[int, int]
    """Width and height [pixels]"""
    samples: int
    """Number of rays a pixel, in each moment"""
    shutter: float
    """Shutter time [frames]"""
    transparent: bool
    """Whether to omit the backdrop"""


@checked
def render_stage(
    path: str | Path,
    output: str | Path,
    frame: int | None = None,
    size: tuple[int, int] = (960, 540),
    samples: int = 4,
    device: str | None = None,
    azimuth: float | None = None,
    elevation: float | None = None,
    on_frame: Callable[[int, int], None] = lambda done, count: None,
    *,
    zoom: float | None = None,
    look_at: str | tuple[float, float, float] | None = None,
    follow: bool = False,
    aperture: float = 0.0,
    focus: str | tuple[float, float, float] | None = None,
    shutter: float = 0.0,
    transparent: bool = False,
    frames: tuple[int | None, int | None] | None = None,
    frames_per_second: float | None = None,
    on_note: Callable[[str], None] = lambda sentence: None,
) -> list[int]:
    """Make a picture (.png) or an animation (.webp, .gif, .mp4) of a stage. The file appears whole or not at all.

    Args:
        path: Any USD stage with meshes, spheres or linear curves.
        output: Picture to write.
        frame: Frame of a .png; if not given, the one that the stage names as its picture, else the last.
        size: Width and height in pixels.
        samples: Rays per pixel.
        device: Warp device; the GPU, or else the CPU, if not given.
        azimuth: Azimuth of the camera [degrees], from the front, +Z, or -Y where Z is up, toward +X; `AZIMUTH` if
            not given.
        elevation: Elevation, 0 to 90 [degrees]; `ELEVATION` if not given. Without both, the stage's camera is taken.
        on_frame: Called with the number of frames done, and of all.
        zoom, look_at, follow, aperture, focus: As in `View`; if not given, those of the stage's picture, if it has
            one.
        shutter: Shutter time in frames, 0 to 1, for motion blur. It takes `MOMENTS` times as long.
        transparent: Omit backdrop, ground and water, for a .png or .webp that is laid over something else. The
            ground's shadow stays, unless there is water.
        frames: First and last frame of an animation; the stage's if not given.
        frames_per_second: Frame rate of an animation, which keeps its true speed; the stage's if not given.
        on_note: Called with sentences on missing files of the stage, and on shapes that are not drawn.

    Returns:
        The frames that were drawn.

    Raises:
        InputError: there is no such stage or frame, nothing to draw, or the output cannot be written.
        MissingExtraError: an .mp4 is wanted and imageio-ffmpeg is not installed.
    """
    path, output = Path(path), Path(output)
    suffix = output.suffix.lower()
    check_writable(output, PICTURE_SUFFIXES)
    _check_request(suffix, frame, size, samples)
    view = check_view(
        output,
        shutter,
        transparent,
        azimuth=azimuth,
        elevation=elevation,
        zoom=zoom,
        look_at=look_at,
        follow=follow,
        aperture=aperture,
        focus=focus,
    )
    _check_span(output, frames, frames_per_second)
    stage = RenderStage(path, on_note=on_note)
    chosen, frame_seconds = _choose_frames(stage, suffix, frame, frames, frames_per_second)
    film = Film(size, samples, shutter, transparent)
    pictures = _pictures(stage, chosen, film, device, view, on_frame)
    with sole_writer(output), whole_file(output) as temporary:
        if suffix == ".png":
            write_png(temporary, next(pictures))
        elif suffix in MOST_RATE:
            (write_gif if suffix == ".gif" else write_webp)(temporary, pictures, frame_seconds)
        else:
            write_mp4(temporary, pictures, 1.0 / frame_seconds)
    return chosen


def _check_request(suffix: str, frame: int | None, size: tuple[int, int], samples: int) -> None:
    if min(size) < 1:
        raise InputError(f"size: a picture of {size[0]}x{size[1]} pixels; expected at least 1x1")
    if max(size) > MOST_PIXELS:
        raise InputError(f"size: a picture of {size[0]}x{size[1]} pixels; expected at most {MOST_PIXELS}x{MOST_PIXELS}")
    if samples < 1:
        raise InputError(f"samples: {samples} rays a pixel; expected at least 1")
    if samples > MOST_SAMPLES:
        raise InputError(f"samples: {samples} rays a pixel; expected at most {MOST_SAMPLES}")
    if suffix == ".mp4":
        require_ffmpeg()
        if size[0] % 2 or size[1] % 2:
            raise InputError(f"size: {size[0]}x{size[1]} for an .mp4; expected an even width and height")
    if frame is not None and suffix != ".png":
        raise InputError(f"frame: {frame} for a {suffix}, which shows all frames; expected a .png")


def _check_span(output: Path, frames: object, rate: float | None) -> None:
    if output.suffix.lower() == ".png" and (frames or rate) is not None:
        raise InputError(f"{output}: one picture has no frames and no rate; expected a .webp, .gif or .mp4, or --frame")


def _choose_frames(
    stage: RenderStage,
    suffix: str,
    frame: int | None,
    part: tuple[int | None, int | None] | None = None,
    rate: float | None = None,
) -> tuple[list[int], float]:
    """Choose the frames to draw, and how long each is shown [s]."""
    first, last = stage.first_frame, stage.last_frame
    if part is not None:
        begin, end = (own if given is None else given for own, given in zip((first, last), part, strict=True))
        if not first <= begin <= end <= last:
            raise InputError(f"frames: {begin}:{end} is not in {stage.path}; expected a range in {first}:{last}")
        first, last = begin, end
    if suffix == ".png":
        chosen = stage.picture_frame if frame is None else frame
        if not first <= chosen <= last:
            raise InputError(f"frame: {chosen} is not in {stage.path}; expected {first} to {last}")
        return [chosen], 0.0
    least, most = FRAMES_PER_SECOND
    if not least <= stage.frames_per_second <= most:
        raise InputError(
            f"{stage.path}: its timeCodesPerSecond is {stage.frames_per_second:g}; "
            f"expected {least:g} to {most:g} for a {suffix}"
        )
    if last - first >= MOST_FRAMES:
        raise InputError(
            f"{stage.path}: has frames {first:g} to {last:g}; expected at most {MOST_FRAMES} for a {suffix}"
        )
    if rate is not None:
        if not least <= rate <= most:
            raise InputError(f"fps: {rate:g}; expected {least:g} to {most:g}")
        count = math.floor((last - first) * rate / stage.frames_per_second + 1e-9) + 1
        if count > MOST_FRAMES:
            raise InputError(f"fps: {rate:g} makes {count:,} pictures; expected at most {MOST_FRAMES:,}")
        return [first + round(number * stage.frames_per_second / rate) for number in range(count)], 1.0 / rate
    step = 1
    if suffix in MOST_RATE:
        too_fast = stage.frames_per_second / MOST_RATE[suffix]
        too_many = (last - first + 1) / MOST_PICTURES
        step = max(1, math.ceil(too_fast - 1e-9), math.ceil(too_many))
    return list(range(first, last + 1, step)), step / stage.frames_per_second


def _pictures(
    stage: RenderStage,
    frames: list[int],
    film: Film,
    device: str | None,
    view: View,
    on_frame: Callable[[int, int], None],
) -> Iterator[Picture]:
    from balloon_warp.studio.render.raycaster import RayCaster  # loads Warp: only once the stage is known to be good

    def cast() -> RayCaster:
        center, size = framing.center, framing.size
        return RayCaster(stage, center, size, film.size, film.samples, device, transparent=film.transparent)

    stage.read_prims(frames[0])
    width, height = film.size
    framing, camera_of = view.cameras(stage, frames, width / height)
    caster, seen = cast(), stage.seen(frames[0])

    def picture(moment: float, camera: Camera) -> Picture:
        nonlocal caster, seen
        if stage.seen(moment) != seen:  # a string is cut, or a sphere comes
            stage.read_prims(moment, may_be_none=True)
            caster, seen = cast(), stage.seen(moment)
        caster.place(moment, 0.5 * LEAST_LINE_PIXELS * camera.pixel_size(framing.center, height))
        return caster.picture(camera)

    for done, frame in enumerate(frames, start=1):
        camera = camera_of(frame)
        open_at = moments(frame, film.shutter, stage.last_frame)
        pictures = (picture(moment, camera) for moment in open_at)
        yield next(pictures) if len(open_at) == 1 else one_over_the_other(pictures)
        on_frame(done, len(frames))


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
