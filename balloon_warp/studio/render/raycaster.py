"""Runs the ray casting kernels: uploads shapes and lights, moves them, and takes pictures."""

import os
from collections.abc import Callable
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.kernels.pictures import raycast
from balloon_warp.kernels.pictures.surfaces import KEY, KEY_RADIANCE, Prints, Shapes, Studio
from balloon_warp.mesh.polygon_mesh import Color
from balloon_warp.scene.around import GROUND_COLOR
from balloon_warp.studio.render.stage_reader import Capsules, RenderStage
from balloon_warp.studio.render.surface import disc_points, spread_points
from balloon_warp.system.loading import Threads
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


class RayCaster:
    """Pictures of one stage.

    The kernels see the action about the origin and about one unit large, whatever the stage's unit.

    Args:
        stage: its prims have been read.
        center: the middle of the action in the world, shape (3,).
        size: how large the action is, in the stage's unit.
        picture_size: Width and height in pixels.
        samples: Rays per pixel.
        device: Warp device; the GPU, or else the CPU, if not given.
        threads: CPU threads; all cores when missing. The picture does not depend on it.
        transparent: Omit backdrop, water, and ground but for the shadows on it; pictures say how opaque they are
            then.

    Raises:
        InputError: there is no such device.
    """

    def __init__(
        self,
        stage: RenderStage,
        center: NDArray[np.float64],
        size: float,
        picture_size: tuple[int, int],
        samples: int,
        device: str | None = None,
        threads: int | None = None,
        *,
        transparent: bool = False,
    ):
        self._stage, self._center, self._size, self._samples = stage, center, size, samples
        self._width, self._height = picture_size
        self._transparent = transparent
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
