"""Rendering of a stage, or of several alike, as a picture file."""

import math
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray
from PIL import Image

from balloon_warp.errors import InputError, MissingExtraError
from balloon_warp.kernels.pictures import raycast
from balloon_warp.kernels.pictures.surfaces import KEY, KEY_RADIANCE, Prints, Shapes, Studio
from balloon_warp.mesh.polygon_mesh import Color
from balloon_warp.scene.around import GROUND_COLOR
from balloon_warp.studio.render.sampling import disc_points, moments, one_over_the_other, spread_points
from balloon_warp.studio.render.stage_reader import Capsules, RenderStage
from balloon_warp.studio.render.view import Framing, View, check_view, frame_action
from balloon_warp.system.api import checked
from balloon_warp.system.files import check_writable, png_mark, sole_writer, whole_file
from balloon_warp.system.process import Threads
from balloon_warp.system.warp_threads import lock_of, pick_device
from balloon_warp.usd.studio import KEY_AZIMUTH, Camera, turned

RIM = (0.95, 0.28, -0.15)
"""Direction to the strip light"""
KEY_SPREAD = 0.15


def light_studio(camera: Camera, paper: Color = GROUND_COLOR, light: float = KEY_AZIMUTH) -> Any:
    """Return the lights for a camera. They turn with it, but only around the vertical.

    Args:
        paper: color of the backdrop, linear RGB.
        light: azimuth of the key light from the camera toward its right [degrees].
    """
    axes = turned(camera.level_axes, light)
    studio = Studio()
    for name, toward in (("key", KEY), ("rim", RIM)):
        direction = _unit(np.array(toward) @ axes)
        across = _unit(np.cross([0.0, 1.0, 0.0], direction))
        for suffix, vector in (("", direction), ("_right", across), ("_up", np.cross(direction, across))):
            setattr(studio, name + suffix, wp.vec3(*vector))
    studio.key_radiance = wp.vec3(*KEY_RADIANCE)
    studio.paper = wp.vec3(*(np.array(paper) / GROUND_COLOR))
    studio.key_spread = KEY_SPREAD
    return studio


def _unit(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    return vector / np.linalg.norm(vector)


WIDEST_BLUR = 9
"""Largest radius of the smoothing of light with four samples or less [pixels]"""


@dataclass(frozen=True)
class Film:
    """Film of a picture: size, samples and exposure."""

    size: tuple[int, int]
    """Width and height [pixels]"""
    samples: int
    """Number of rays a pixel, in each moment"""
    shutter: float = 0.0
    """Shutter time [frames]"""
    transparent: bool = False
    """Whether to omit backdrop, water, and ground but for the shadows on it; pictures say how opaque they are then"""


class RayCaster:
    """Pictures of one stage.

    The kernels see the action about the origin and about one unit large, whatever the stage's unit.

    Args:
        stage: its prims have been read.
        framing: of the action.
        film: of the pictures.
        device: Warp device; the GPU, or else the CPU, if not given.
        threads: CPU threads; all cores when missing. The picture does not depend on it.

    Raises:
        InputError: there is no such device.
    """

    def __init__(
        self,
        stage: RenderStage,
        framing: Framing,
        film: Film,
        device: str | None = None,
        threads: int | None = None,
    ):
        self._stage, self._center, self._size, self._samples = stage, framing.center, framing.size, film.samples
        self._width, self._height = film.size
        self._transparent = film.transparent
        self.device = pick_device(device)
        self._bands = 1 if self.device.is_cuda else min(threads or os.cpu_count() or 1, self._height)
        self._mesh: wp.Mesh | None = None
        self._bvh: wp.Bvh | None = None
        self._shapes = Shapes()
        with lock_of(self.device):
            self._upload_fixed()
            self._allocate()

    def place(self, frame: float, least_radius: float) -> None:
        """Move everything to where it is at a frame, or between two.

        Args:
            least_radius: of lines, in the stage's unit.
        """
        with lock_of(self.device):
            self._place(frame, least_radius)

    def _place(self, frame: float, least_radius: float) -> None:
        reaches = [0.0]
        if self._stage.meshes:
            reaches.append(self._place_meshes(self._stage.points(frame), self._stage.gone(frame)))
        if self._stage.rounds:
            reaches.append(self._place_capsules(self._stage.capsules(frame), least_radius))
        self._shapes.reach = 1.001 * max(reaches)
        heights = (np.array(self._stage.heights(frame)) - self._center[1]) / self._size
        self._shapes.ground_height, self._shapes.water_height = heights.tolist()

    def picture(self, camera: Camera) -> NDArray[np.uint8]:
        """Return the camera's picture as sRGB bytes, shape (height, width, 3); with opacity (height, width, 4)."""
        lens = raycast.Camera()
        lens.eye = wp.vec3(*self._local(camera.eye))
        right, up, backward = camera.axes
        lens.forward = wp.vec3(*-backward)
        lens.right = wp.vec3(*(camera.half_width * right))
        lens.up = wp.vec3(*(camera.half_height * up))
        lens.aperture, lens.focus = 0.5 * camera.aperture / self._size, camera.focus / self._size
        lens.transparent = self._transparent
        studio = light_studio(camera, **self._stage.picture_light)
        noisy, smooth, surface = self._shares[:2], self._shares[2:], [self._places, self._normals]
        light = [self._plain, self._key, self._sky]
        radius = max(2, round(WIDEST_BLUR * min(1.0, (4.0 / self._samples) ** 0.5)))
        inputs = [self._shapes, studio, lens, self._pixel_samples, self._disc_samples, self._lens_samples]
        ground = [*self._ground_light, self._ground_shares]
        with lock_of(self.device):
            self._launch(raycast.cast_pixels, inputs, [*light, *noisy, *surface, self._backdrops, *ground])
            self._launch(raycast.smooth_light, [*noisy, *surface, radius, 0, 1], smooth)
            self._launch(raycast.smooth_light, [*smooth, *surface, radius, 1, 0], noisy)
            self._launch(raycast.develop, [*light, *noisy, self._backdrops, *ground], [self._picture])
            return np.array(self._picture.numpy(), np.uint8)  # a copy: on the CPU the next picture would change a view

    def _launch(self, kernel: Any, inputs: list, outputs: list) -> None:
        """Launch each band on a thread of its own, since a launch on the CPU uses one core and frees the GIL."""

        def launch(band: int) -> None:
            rows = len(range(band, self._height, self._bands))
            wp.launch(
                kernel,
                dim=(rows, self._width),
                inputs=[*inputs, band, self._bands],
                outputs=outputs,
                device=self.device,
            )

        if self._bands == 1:
            launch(0)
        else:
            list(self._pool.map(launch, range(self._bands)))

    def _upload_fixed(self) -> None:
        meshes, shapes = self._stage.meshes, self._stage.rounds
        starts = np.cumsum([0, *(mesh.surface.vertex_count for mesh in meshes)])
        if meshes:
            corners = [mesh.surface.triangles + start for mesh, start in zip(meshes, starts, strict=False)]
            self._corners = np.concatenate(corners)
            self._shapes.corners = self._array(self._corners.ravel(), wp.int32)
            self._shapes.colors = self._array(np.concatenate([mesh.cover.colors for mesh in meshes]))
            self._shapes.prints = self._prints()
            finishes = [mesh.cover.finishes for mesh in meshes]
            self._shapes.finishes = self._array(np.concatenate(finishes), wp.vec4)
        if shapes:
            self._shapes.capsule_colors = self._array(np.concatenate([shape.colors for shape in shapes]))
            finishes = [np.tile(shape.finish.as_row(), (shape.segment_count, 1)) for shape in shapes]
            self._shapes.capsule_finishes = self._array(np.concatenate(finishes), wp.vec4)
        ground = self._stage.ground
        # Nobody sees that a picture without its water had some: a shadow at the bottom would be nowhere.
        caught = self._stage.water is None
        self._shapes.has_ground = int(ground is not None and (caught or not self._transparent))
        self._shapes.ground_color = wp.vec3(*self._stage.picture_light.get("paper", (0.5, 0.5, 0.5)))
        if ground is not None:
            self._shapes.ground_color = wp.vec3(*ground.color.tolist())
        water = self._stage.water
        self._shapes.has_water = int(water is not None and not self._transparent)
        if water is not None:
            self._shapes.water_color = wp.vec3(*water.color.tolist())

    def _prints(self) -> Any:
        """Return the images that are on meshes."""
        prints, covers = Prints(), [mesh.cover for mesh in self._stage.meshes]
        images = [image for cover in covers for image in cover.images]
        if images:
            starts = np.cumsum([0, *(image.shape[0] * image.shape[1] for image in images)])
            rows = [(start, image.shape[1], image.shape[0]) for start, image in zip(starts, images, strict=False)]
            prints.texels = self._array(np.concatenate([image.reshape(-1, 3) for image in images]))
            prints.images = self._array(np.array(rows), wp.vec3i)
            firsts = np.cumsum([0, *(len(cover.images) for cover in covers)])
            own = [
                np.where(c.image_of_triangle < 0, -1, c.image_of_triangle + n)
                for c, n in zip(covers, firsts, strict=False)
            ]
            prints.of_triangle = self._array(np.concatenate(own), wp.int32)
            places = [np.zeros((len(cover.colors), 2)) if cover.places is None else cover.places for cover in covers]
            prints.places = self._array(np.concatenate(places), wp.vec2)
        return prints

    def _allocate(self) -> None:
        shape = (self._height, self._width)
        with wp.ScopedDevice(self.device):
            vectors = [wp.zeros(shape, dtype=wp.vec3) for _ in range(5)]
            self._plain, self._key, self._sky, self._places, self._normals = vectors
            self._shares = [wp.zeros(shape, dtype=wp.vec4) for _ in range(4)]
            self._backdrops = wp.zeros(shape, dtype=float)
            caught = shape if self._transparent else (0, 0)
            self._ground_light = [wp.zeros(caught, dtype=wp.vec3) for _ in range(2)]
            self._ground_shares = wp.zeros(caught, dtype=float)
            self._picture = wp.zeros((*shape, 4 if self._transparent else 3), dtype=wp.uint8)
            self._pixel_samples = wp.array(spread_points(self._samples), dtype=wp.vec2)
            self._lens_samples = wp.array(disc_points(self._samples), dtype=wp.vec2)
            self._disc_samples = wp.array(disc_points((self._samples + 1) // 2), dtype=wp.vec2)
            wp.load_module(raycast, device=self.device)
        self._pool = Threads(self._bands)

    def _place_meshes(self, points: list[NDArray[np.float64]], gone: NDArray[np.bool_] | None) -> float:
        """Place the meshes, and return their largest distance from the origin."""
        placed = [mesh.surface.place(each) for mesh, each in zip(self._stage.meshes, points, strict=True)]
        local = self._local(np.concatenate([vertices for vertices, _ in placed]))
        vertices = self._array(local)
        self._shapes.normals = self._array(np.concatenate([normals for _, normals in placed]))
        shrunk = [mesh.shrunk(each) for mesh, each in zip(self._stage.meshes, points, strict=True)]
        self._shapes.shrunk = self._array(np.concatenate(shrunk), wp.float32)
        if gone is not None:  # curves that are gone have no width
            self._mesh = None
            corners = np.where(gone[:, None], self._corners[:, :1], self._corners)
            self._shapes.corners = self._array(corners.ravel(), wp.int32)
        if self._mesh is None:
            self._mesh = wp.Mesh(vertices, self._shapes.corners)
            self._shapes.mesh = self._mesh.id
        else:
            wp.copy(self._mesh.points, vertices)
            self._mesh.refit()
        return float(np.linalg.norm(local, axis=1).max())

    def _place_capsules(self, capsules: Capsules, least_radius: float) -> float:
        """Place the capsules, and return their largest distance from the origin."""
        begins, ends = self._local(capsules.begins), self._local(capsules.ends)
        radii = np.maximum(capsules.radii, least_radius) / self._size
        lowers = self._array(np.minimum(begins, ends) - radii[:, None])
        uppers = self._array(np.maximum(begins, ends) + radii[:, None])
        self._shapes.begins, self._shapes.ends = self._array(begins), self._array(ends)
        self._shapes.radii = self._array(radii, wp.float32)
        if self._bvh is None:
            self._bvh = wp.Bvh(lowers, uppers)
            self._shapes.capsules = self._bvh.id
        else:
            wp.copy(self._bvh.lowers, lowers)
            wp.copy(self._bvh.uppers, uppers)
            self._bvh.refit()
        return float((np.linalg.norm([begins, ends], axis=2) + radii).max())

    def _local(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        return (points - self._center) / self._size

    def _array(self, values: NDArray, dtype: Callable = wp.vec3) -> wp.array:
        return wp.array(values, dtype=dtype, device=self.device)


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

    def cast() -> RayCaster:
        return RayCaster(stage, framing, film, device)

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
        caster = RayCaster(stage, framing, Film(size, samples), device)
        caster.place(frame, 0.5 * LEAST_LINE_PIXELS * pixel)
        yield caster.picture(framing.camera)
