"""Layers of the page: one for each kind of thing, which can be shown and hidden.

Images on balloons in the page. viser's meshes have no texture coordinates, so page_files/look.js puts images on.

For that, two things that nobody sees hang below a balloon's node: the image, and a mesh of places. Each of its points
is (right, up, twin) for a point of the balloon: where it is in the image, and the first point at the same place.
"""

import io
from collections.abc import Callable
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np
import trimesh
import viser
from numpy.typing import NDArray
from PIL import Image
from scipy.spatial.transform import Rotation

from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.topology import triangulate
from balloon_warp.model.obstacles import ObstacleShape
from balloon_warp.scene import Balloon
from balloon_warp.scene.around import looks_of_file
from balloon_warp.studio.page import drawings
from balloon_warp.studio.page.drawings import (
    KNOTS,
    LEVELS,
    Drawing,
    KnotLayer,
    LevelLayer,
    Lines,
    Plain,
    Smooth,
    go_home,
    hit_distance,
    home_of,
    string_reach,
    surfaces_of,
)
from balloon_warp.studio.page.session import Picture
from balloon_warp.studio.render.view import BACKDROP
from balloon_warp.usd.solids import SIZES

Surface = tuple[NDArray[np.float64], NDArray[np.integer[Any]]]
"""Points [m], shape (n, 3), and triangles, shape (m, 3)"""
ROUND = 32
"""Number of corners of a circle"""
OBSTACLES = "/obstacles"


class ObstacleLayer:
    """Obstacles and bodies of a scene.

    Args:
        server: Server of the page.
        picture: First picture of the scene.
        center: Center of the balloons at the start [m], shape (3,).
        size: Size of the balloons [m].
    """

    def __init__(self, server: viser.ViserServer, picture: Picture, center: NDArray[np.floating], size: float):
        server.scene.add_frame(OBSTACLES, show_axes=False)
        self._meshes, self._surfaces, seen = [], [], [np.zeros((0, 3))]
        model = picture.model
        shapes = [*model.obstacles, *(body.solid for body in model.bodies)]
        own_colors = [drawings.obstacle_color(picture.scene, n, shape.mesh) for n, shape in enumerate(model.obstacles)]
        own_colors += [drawings.body_color(picture.scene, n, body.solid.mesh) for n, body in enumerate(model.bodies)]
        for number, (shape, pose, color) in enumerate(zip(shapes, _poses(picture), own_colors, strict=True)):
            below = Rotation.from_quat(pose[3:]).inv().apply(center - pose[:3])
            points, triangles = surface_of(shape, picture.scene.up, below, SIZES * size)
            mesh = server.scene.add_mesh_simple(
                f"{OBSTACLES}/{number}",
                points,
                triangles,
                color=color,
                flat_shading=shape.kind != "capsule",
                side="double",
            )
            self._meshes.append(mesh)
            self._surfaces.append((points, triangles))
            if np.ptp(points, axis=0).max() <= BACKDROP * size:
                seen.append(Rotation.from_quat(pose[3:]).apply(points) + pose[:3])
        self.seen = np.concatenate(seen)
        """Points of those that are to be seen as a whole, at their first place [m], shape (n, 3)"""
        self._shown: list[NDArray[np.float64] | None] = [None] * len(self._meshes)

    def draw(self, picture: Picture) -> None:
        """Move obstacles and bodies to their poses; the page is told only of changes."""
        for number, (mesh, pose) in enumerate(zip(self._meshes, _poses(picture), strict=True)):
            shown = self._shown[number]
            if shown is None or not np.array_equal(shown, pose):
                mesh.position, mesh.wxyz = tuple(pose[:3].tolist()), tuple(pose[[6, 3, 4, 5]].tolist())
                self._shown[number] = pose

    def hit_distance(self, origin: NDArray[np.floating], direction: NDArray[np.floating]) -> float | None:
        """Return the distance along a ray to the nearest of them, where they were drawn last, or None."""
        hits = []
        for (points, triangles), pose in zip(self._surfaces, self._shown, strict=True):
            if pose is not None:
                back = Rotation.from_quat(pose[3:]).inv()
                hits.append(hit_distance(back.apply(origin - pose[:3]), back.apply(direction), points, triangles))
        return min((hit for hit in hits if hit is not None), default=None)


def _poses(picture: Picture) -> NDArray[np.float64]:
    """Return the poses of all that have one, shape (n, 7)."""
    return np.concatenate([picture.frame.obstacle_poses, picture.frame.body_poses.astype(np.float64)])


def surface_of(
    shape: ObstacleShape, up: tuple[float, float, float], below: NDArray[np.floating], half: float
) -> Surface:
    """Return the surface that is drawn of a shape, about its own origin.

    Args:
        up: Unit vector of the up axis.
        below: Point over the middle of the drawn part of a plane [m], shape (3,).
        half: Half its side [m].
    """
    if shape.mesh is not None:
        return shape.mesh.points, triangulate(shape.mesh)[0]
    if shape.kind == "box":
        box = trimesh.creation.box(2.0 * shape.size)
        return np.asarray(box.vertices), np.asarray(box.faces)
    to_up = Rotation.align_vectors([up], [(0.0, 0.0, 1.0)])[0]
    if shape.kind == "capsule":
        capsule = trimesh.creation.capsule(2.0 * shape.size[1], shape.size[0], count=[ROUND, ROUND])
        points = np.asarray(capsule.vertices) - capsule.bounds.mean(axis=0)
        return to_up.apply(points), np.asarray(capsule.faces)
    square = to_up.apply(half * np.array([(-1.0, -1.0, 0.0), (1.0, -1.0, 0.0), (1.0, 1.0, 0.0), (-1.0, 1.0, 0.0)]))
    level = below - np.dot(below, up) * np.array(up)
    return level + square, np.array([(0, 1, 2), (0, 2, 3)])


PRESSES = "/contacts"
LONGEST = 0.4
"""Length of the arrow of the strongest force, over the balloons' size"""
LEAST = 0.02
"""Fraction of the strongest force below which a force has no arrow"""
FADING = 0.99
"""Decay factor of the strongest force from picture to picture, so that an impact does not dwarf later ones"""
THIN = 0.012
"""Radius of the shafts, over the balloons' size"""
CLEAR = 0.45
"""Opacity of balloons while arrows are shown"""


class PressLayer:
    """Arrows of net forces of contacts, in scenes that have `contacts`.

    Args:
        server: of the page.
        size: of the balloons [m].
    """

    def __init__(self, server: viser.ViserServer, size: float):
        server.scene.remove_by_name(PRESSES)
        self._size, self._strongest = size, 0.0
        nothing, thin = np.zeros((1, 2, 3), np.float32), THIN * size
        self._arrows: Any = server.scene.add_arrows(
            PRESSES, nothing, drawings.CONTACTS, visible=False,
            shaft_radius=thin, head_radius=2.5 * thin, head_length=6.0 * thin,
        )  # fmt: skip

    def draw(self, picture: Picture, shown: bool) -> None:
        """Show the net contact forces on a picture's balloons."""
        arrows = self.arrows_of(picture) if shown else np.zeros((0, 2, 3), np.float32)
        if len(arrows):
            self._arrows.points = arrows
        if self._arrows.visible != (len(arrows) > 0):
            self._arrows.visible = len(arrows) > 0

    def arrows_of(self, picture: Picture) -> Lines:
        """Find where the arrows begin, where a balloon is pressed, and where they end."""
        contacts = picture.frame.contacts
        forces, places = (
            np.array([getattr(each, name) for each in contacts]).reshape(-1, 3) for name in ("force", "place")
        )
        return self._scaled(forces, places)

    def _scaled(self, forces: NDArray[np.float64], places: NDArray[np.float64]) -> Lines:
        sizes = np.linalg.norm(forces, axis=1)
        self._strongest = max(float(sizes.max(initial=0.0)), FADING * self._strongest)
        seen = (sizes > LEAST * self._strongest) & (sizes > 0.0)
        lengths = LONGEST * self._size / max(self._strongest, 1e-30)
        return np.stack([places, places + lengths * forces], axis=1)[seen].astype(np.float32)


LARGEST = 1024
"""Largest side of an image [texels]: a larger one is scaled down"""


class Printed:
    """A surface, cut along the seams of an image: each of its points has one place there.

    Args:
        surface: of a balloon.
        mesh: of the same balloon, with texture coordinates.
    """

    def __init__(self, surface: Plain | Smooth, mesh: PolygonMesh):
        corners = surface.spread(np.asarray(mesh.texture_coordinates, dtype=np.float64)).reshape(-1, 2)
        keys = np.column_stack([surface.triangles.reshape(-1), corners])
        kept, numbers = np.unique(keys, axis=0, return_inverse=True)
        self._surface, self._points = surface, kept[:, 0].astype(np.int64)
        _, firsts, points = np.unique(self._points, return_index=True, return_inverse=True)
        self.triangles = numbers.reshape(-1, 3)
        """Triangles, shape (n, 3)"""
        self.triangle_faces = surface.triangle_faces
        """Face of the mesh of each triangle, shape (n,)"""
        self.places = np.column_stack([kept[:, 1:], firsts[points]]).astype(np.float32)
        """Texture coordinates to the right and up, and twin of each point, shape (n, 3)"""

    def points(self, points: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the points of the surface from those of the mesh; shape (n, 3)."""
        return self._surface.points(points)[self._points]


def only_picture(mesh: PolygonMesh, said: Balloon) -> io.BytesIO | None:
    """Return the image of a mesh's file, where it is on all of its faces and the scene says no color."""
    looks = looks_of_file(mesh, said)
    if looks is None or len(looks.pictures) != len(looks.materials) or len(looks.materials) != 1:
        return None
    return io.BytesIO(looks.pictures[0].data) if (looks.of_corners == 0).all() else None


def image_of(file: Path | io.BytesIO | None) -> NDArray[np.uint8] | None:
    """Return a print as the page gets it, shape (height, width, 3); None where there is none, or it cannot be read."""
    if file is None:
        return None
    try:
        with Image.open(file) as image:
            image.thumbnail((LARGEST, LARGEST))
            return np.asarray(image.convert("RGB"))
    except (OSError, ValueError, Image.DecompressionBombError):
        return None


def hang(scene: viser.SceneApi, balloon: str, surface: Printed, image: NDArray[np.uint8]) -> list[Any]:
    """Add a print below a balloon's node, too small to be hit by a pointer.

    Args:
        balloon: Name of its node.
    """
    nothing = np.zeros((1, 3), np.uint32)
    return [
        scene.add_mesh_simple(f"{balloon}/places", surface.places, nothing, cast_shadow=False, visible=False),
        scene.add_image(f"{balloon}/print", image, 1e-9, 1e-9, format="png", cast_shadow=False, visible=False),
    ]


LAYERS = {
    "balloon": "smooth balloon",
    "strain": "strain as color",
    "wire": "wireframe",
    "structural": "structural springs (black)",
    "shear": "shear springs (blue)",
    "flexion": "flexion springs (green)",
    "normals": "vertex normals",
    "forces": "net forces",
    "contacts": "contact forces",
    "shadow": "shadow",
}
"""Layers and their labels"""
AT_START = ("balloon", "contacts", "shadow")
LINES = {
    "wire": drawings.WIRE,
    **drawings.SPRINGS,
    "normals": drawings.NORMALS,
    "forces": drawings.FORCES,
}
LIGHT = 2.8
"""Intensity of the studio's key light; the page finds its place and its shadow itself (page_files/look.js)"""
SLOWER = 3
"""Number of pictures between two drawings of large layers"""


class Layers:
    """Draws pictures into a page.

    Args:
        server: of the page.
        on_drag: called with each movement of a pointer that began on a balloon; if missing, that turns the camera.
    """

    def __init__(self, server: viser.ViserServer, on_drag: Callable[[Any], Any] | None = None):
        self.server, self._on_drag = server, on_drag
        self.shown = {name: name in AT_START for name in LAYERS}
        self._load, self._count = 0, 0
        self._coming: tuple[viser.IcosphereHandle, int] | None = None
        """Sphere that was asked for, and the number of its command"""
        self._pending_lock = Lock()
        """Lock of that sphere: each click has a thread of its own"""
        server.scene.configure_default_lights(enabled=False)
        self._key_light = server.scene.add_light_directional("/light", intensity=LIGHT, cast_shadow=True)

    def show(self, name: str, shown: bool) -> None:
        """Show or hide a layer."""
        self.shown[name] = shown
        if name == "shadow":
            self._key_light.cast_shadow = shown

    def draw(self, picture: Picture) -> None:
        """Bring everything that is shown up to date."""
        with self.server.atomic():
            if picture.load != self._load:
                self._build(picture)
            self._draw_balloons(picture)
            self._draw_lines(picture)
            self._presses.draw(picture, self._presses_shown(picture))
            self._draw_spheres(picture)
            self.obstacles.draw(picture)
            self._levels.draw(picture)
            self._draw_strings(picture)
        self._count += 1
        self.server.flush()

    def draw_pending_sphere(
        self, position: NDArray[np.floating], radius: float, color: drawings.Color, asked: int
    ) -> None:
        """Draw a sphere that was asked for where it will start, until a picture shows the outcome.

        Args:
            asked: number of commands until then.
        """
        with self._pending_lock:
            coming = self.server.scene.add_icosphere(
                "/spheres/coming", radius=radius, color=color, subdivisions=4, position=tuple(position.tolist())
            )
            self._coming = coming, asked
        self.server.flush()

    @property
    def drawing(self) -> Drawing:
        """Drawing of the model that is shown."""
        return self._drawing

    def _build(self, picture: Picture) -> None:
        """Rebuild everything for another model."""
        scene, self._load = self.server.scene, picture.load
        with self._pending_lock:
            self._coming = None
            for name in ("/balloons", "/strain", "/lines", "/spheres", "/strings", LEVELS, KNOTS, OBSTACLES):
                scene.remove_by_name(name)
        self._drawing = Drawing(picture.model)
        start = np.concatenate([shape.mesh.points for shape in picture.model.shapes])
        low, high = start.min(axis=0), start.max(axis=0)
        self.size = float((high - low).max())
        up = np.array(picture.scene.up)
        scene.set_up_direction("+y" if picture.scene.up_axis == "Y" else "+z")
        side = np.array([0.55, 0.0, 1.0]) if picture.scene.up_axis == "Y" else np.array([0.55, -1.0, 0.0])
        center = (low + high) / 2
        self.obstacles = ObstacleLayer(self.server, picture, center, self.size)
        self._levels = LevelLayer(self.server, picture, center, self.size)
        self._presses = PressLayer(self.server, self.size)
        around = [start, string_reach(picture.model, up), self.obstacles.seen]
        self.home = home_of(np.concatenate(around), up, side)
        for camera in [self.server.initial_camera, *(client.camera for client in self.server.get_clients().values())]:
            go_home(camera, *self.home)
        self._balloons, self._bands = [], []
        self._colors = [balloon.color for balloon in picture.scene.balloon]
        scene.add_frame("/balloons", show_axes=False)
        scene.add_frame("/strain", show_axes=False)
        scene.add_frame("/lines", show_axes=False)
        scene.add_frame("/spheres", show_axes=False)
        self._surfaces: list[Any] = list(surfaces_of(picture.model))
        for number, points in enumerate(picture.frame.points):
            triangles = self._drawing.triangles[number]
            balloon = self._add_balloon(picture, number, points)
            self._balloons.append(balloon)
            bands = [
                scene.add_mesh_simple(f"/strain/{number}_{band}", points, triangles[:1], color=color, side="double")
                for band, color in enumerate(drawings.STRAIN)
            ]
            self._bands.append(bands)
            if self._on_drag is not None:
                for mesh in (balloon, *bands):
                    mesh.on_drag("left")(self._on_drag)
        nothing = np.zeros((1, 2, 3), np.float32)
        self._lines = {
            name: scene.add_line_segments(
                f"/lines/{name}", nothing, color, thickness=1.5, thickness_units="screen", visible=False
            )
            for name, color in LINES.items()
        }
        self._strings = scene.add_line_segments(
            "/strings", nothing, np.zeros((1, 2, 3), np.uint8), thickness=0.008 * self.size
        )
        self._knots = KnotLayer(self.server)
        self._spheres: dict[int, viser.IcosphereHandle] = {}

    def _add_balloon(self, picture: Picture, number: int, points: NDArray[np.float32]) -> Any:
        """Add a balloon's surface, with its print if it has one."""
        mesh = picture.model.shapes[number].mesh
        name, surface, color = (
            f"/balloons/{number}",
            self._surfaces[number],
            drawings.balloon_color(picture.scene, number, mesh),
        )
        image = image_of(picture.scene.balloon[number].print or only_picture(mesh, picture.scene.balloon[number]))
        if image is not None:
            surface, color = Printed(surface, mesh), drawings.PAPER
            self._surfaces[number] = surface
        balloon = self.server.scene.add_mesh_simple(
            name, surface.points(points), surface.triangles, color=color, side="double"
        )
        if isinstance(surface, Printed) and image is not None:
            hang(self.server.scene, name, surface, image)
        return balloon

    def _draw_balloons(self, picture: Picture) -> None:
        strained = self.shown["strain"]
        for number, (balloon, bands) in enumerate(zip(self._balloons, self._bands, strict=True)):
            points = picture.frame.points[number]
            _see(balloon, self.shown["balloon"] and not strained)
            if balloon.opacity != (opacity := CLEAR if self._presses_shown(picture) else None):
                balloon.opacity = opacity
            color = picture.scene.balloon[number].color
            if color != self._colors[number]:
                self._colors[number] = color
                mesh = picture.model.shapes[number].mesh
                if not isinstance(self._surfaces[number], Printed):
                    balloon.color = drawings.balloon_color(picture.scene, number, mesh)
            if balloon.visible:
                balloon.vertices = self._surfaces[number].points(points)
                self._hide_torn(picture, number, balloon)
            if strained and self._count % SLOWER == 0:
                for band, triangles in zip(bands, self._drawing.strain_bands(picture, number), strict=True):
                    _see(band, len(triangles) > 0)
                    if len(triangles):
                        used, faces = np.unique(triangles, return_inverse=True)
                        band.faces = np.zeros((0, 3), np.uint32)  # none that the new points lack
                        band.vertices, band.faces = points[used], faces.reshape(-1, 3).astype(np.uint32)
            elif not strained:
                for band in bands:
                    _see(band, False)

    def _presses_shown(self, picture: Picture) -> bool:
        return self.shown["contacts"] and picture.model.scene.contacts

    def _hide_torn(self, picture: Picture, number: int, balloon: Any) -> None:
        """Hide the triangles of torn faces; they are sent only when they change."""
        if picture.frame.torn:
            surface = self._surfaces[number]
            whole = ~picture.frame.torn[number][surface.triangle_faces]
            if whole.any() and whole.sum() != len(balloon.faces):
                balloon.faces = surface.triangles[whole].astype(np.uint32)

    def _draw_lines(self, picture: Picture) -> None:
        wanted: dict[str, Callable[[], Lines]] = {
            "wire": lambda: self._drawing.springs(picture, "structural"),
            "normals": lambda: self._drawing.normals(picture, 0.03 * self.size),
        }
        for kind in drawings.SPRINGS:
            wanted[kind] = lambda kind=kind: self._drawing.springs(picture, kind)
        if picture.frame.net_forces:
            wanted["forces"] = lambda: self._drawing.net_forces(picture, 0.15 * self.size)
        for name, lines in self._lines.items():
            _see(lines, self.shown[name] and name in wanted)
            if lines.visible and self._count % SLOWER == 0:
                lines.points = wanted[name]()

    def _draw_spheres(self, picture: Picture) -> None:
        radii = picture.model.parameters["sphere_radius"].numpy()[0]
        there = {
            number: place for place, number in enumerate(picture.sphere_numbers) if place < len(radii) and radii[place]
        }
        with self._pending_lock:
            if self._coming and picture.executed >= self._coming[1]:
                self._coming[0].remove()
                self._coming = None
        for number in self._spheres.keys() - there.keys():
            self._spheres.pop(number).remove()
        for number, place in there.items():
            position = tuple(picture.frame.sphere_positions[place].tolist())
            if number not in self._spheres:
                color = drawings.sphere_color(number, picture.scene.sphere[place].color)
                self._spheres[number] = self.server.scene.add_icosphere(
                    f"/spheres/{number}", radius=1.0, color=color, subdivisions=4, position=position
                )
            self._spheres[number].scale = float(radii[place])
            self._spheres[number].position = position

    def _draw_strings(self, picture: Picture) -> None:
        curves = self._drawing.string_curves(picture)
        self._knots.draw(picture, curves)
        segments, hands = self._drawing.strings(picture, curves)
        _see(self._strings, len(segments) > 0)
        if len(segments):
            colored = np.where(hands[:, None, None], np.array(drawings.HAND), np.array(drawings.STRING)).astype(
                np.uint8
            )
            colored = np.repeat(colored, 2, axis=1)
            if colored.shape == self._strings.colors.shape:
                self._strings.points = segments
            else:
                self._strings = self.server.scene.add_line_segments(
                    "/strings", segments, colored, thickness=0.008 * self.size
                )


def _see(handle: Any, visible: bool) -> None:
    """Send visibility only if it changes."""
    if handle.visible != visible:
        handle.visible = visible
