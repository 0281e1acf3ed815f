"""Layers of the page: one for each kind of thing, which can be shown and hidden."""

from collections.abc import Callable
from threading import Lock
from typing import Any

import numpy as np
import viser
from numpy.typing import NDArray

from balloon_warp.viewer import colors
from balloon_warp.viewer.following import go_home, home_of
from balloon_warp.viewer.geometry import Drawing, Lines, string_reach
from balloon_warp.viewer.knots import ROOT as KNOTS
from balloon_warp.viewer.knots import KnotLayer
from balloon_warp.viewer.levels import ROOT as LEVELS
from balloon_warp.viewer.levels import LevelLayer
from balloon_warp.viewer.obstacles import ROOT as OBSTACLES
from balloon_warp.viewer.obstacles import ObstacleLayer
from balloon_warp.viewer.picture import Picture
from balloon_warp.viewer.presses import CLEAR, PressLayer
from balloon_warp.viewer.prints import Printed, hang, image_of, only_picture
from balloon_warp.viewer.smooth import surfaces_of

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
    "wire": colors.WIRE,
    **colors.SPRINGS,
    "normals": colors.NORMALS,
    "forces": colors.FORCES,
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
        """Sphere that was asked for, and the number of its wish"""
        self._foreseeing = Lock()
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

    def foresee(self, position: NDArray[np.floating], radius: float, color: colors.Color, asked: int) -> None:
        """Draw a sphere that was asked for where it will start, until a picture shows the outcome.

        Args:
            asked: how many wishes there were until then.
        """
        with self._foreseeing:
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
        with self._foreseeing:
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
                for band, color in enumerate(colors.STRAIN)
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
            colors.balloon_color(picture.scene, number, mesh),
        )
        image = image_of(picture.scene.balloon[number].print or only_picture(mesh, picture.scene.balloon[number]))
        if image is not None:
            surface, color = Printed(surface, mesh), colors.PAPER
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
                    balloon.color = colors.balloon_color(picture.scene, number, mesh)
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
        for kind in colors.SPRINGS:
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
        with self._foreseeing:
            if self._coming and picture.granted >= self._coming[1]:
                self._coming[0].remove()
                self._coming = None
        for number in self._spheres.keys() - there.keys():
            self._spheres.pop(number).remove()
        for number, place in there.items():
            position = tuple(picture.frame.sphere_positions[place].tolist())
            if number not in self._spheres:
                color = colors.sphere_color(number, picture.scene.sphere[place].color)
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
            colored = np.where(hands[:, None, None], np.array(colors.HAND), np.array(colors.STRING)).astype(np.uint8)
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
