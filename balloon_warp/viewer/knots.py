"""Knots in the page: a mesh where each string is tied, moved to where it is."""

from typing import Any

import viser
from numpy.typing import NDArray

from balloon_warp.mesh.geometry import triangulate
from balloon_warp.outputs.knot import Knot, has_knot, knot_mesh, knot_size
from balloon_warp.viewer import colors
from balloon_warp.viewer.picture import Picture

ROOT = "/knots"


class KnotLayer:
    """Knots of a scene, whose strings may be tied and cut."""

    def __init__(self, server: viser.ViserServer):
        self._server = server
        self._tied: list[tuple[int, int, int]] = []
        """Strings that have a knot, with the balloon and the particle that each holds"""
        self._knots: list[tuple[Knot, Any]] = []
        self._painted: list[Any] = []

    def draw(self, picture: Picture, curves: dict[int, NDArray]) -> None:
        """Move the knots to their poses.

        Args:
            curves: of the strings that are there, by their numbers, shape (n, 3) each.
        """
        tied = [self._holds(picture, number) for number in curves if _is_knotted(picture, number)]
        painted = [balloon.color for balloon in picture.scene.balloon]
        if tied != self._tied or painted != self._painted:
            self._painted = painted
            self._build(picture, tied)
        for (number, balloon, _), (knot, mesh) in zip(self._tied, self._knots, strict=True):
            pose = knot.pose(picture.frame.points[balloon], curves[number], picture.scene.up)
            mesh.position, mesh.wxyz = tuple(pose[:3].tolist()), tuple(pose[[6, 3, 4, 5]].tolist())

    def _build(self, picture: Picture, tied: list[tuple[int, int, int]]) -> None:
        scene, self._tied, self._knots = self._server.scene, tied, []
        scene.remove_by_name(ROOT)
        scene.add_frame(ROOT, show_axes=False)
        for number, balloon, particle in tied:
            held = picture.model.shapes[balloon].mesh
            made = knot_mesh(knot_size(held), picture.scene.up)
            color, triangles = colors.balloon_color(picture.scene, balloon, held), triangulate(made)[0]
            mesh = scene.add_mesh_simple(f"{ROOT}/{number}", made.points, triangles, color=color, side="double")
            self._knots.append((Knot(held, particle), mesh))

    @staticmethod
    def _holds(picture: Picture, number: int) -> tuple[int, int, int]:
        balloon = picture.scene.string[number].balloon
        particle = int(picture.model.string_particle.numpy()[number])
        return number, balloon, particle - picture.model.particle_offsets[balloon]


def _is_knotted(picture: Picture, number: int) -> bool:
    string = picture.scene.string[number]
    return has_knot(string, picture.scene.balloon[string.balloon])
