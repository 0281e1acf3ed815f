"""Actions of a pointer in the view: throwing, tying and pulling."""

from typing import Any

import numpy as np
import viser

from balloon_warp.errors import InputError
from balloon_warp.studio.page import colors
from balloon_warp.studio.page.camera import ground_distance, hit_distance, nearest_particle, throw_at
from balloon_warp.studio.page.controls import Controls
from balloon_warp.studio.page.layers import Layers
from balloon_warp.studio.page.playground import Playground, Touch
from balloon_warp.studio.page.session import Session

NEAREST = 0.4
"""Least distance of a sphere's start from the camera, over the distance to its target, so that it does not fill the
view"""


class Pointing:
    """Pointer event handlers of the page's view: clicks, and drags by `drag`.

    Args:
        server: of the page.
        session: of the simulation.
        layers: of the view.
        controls: which choose the action of a click.
    """

    def __init__(self, server: viser.ViserServer, session: Session, layers: Layers, controls: Controls):
        self.session, self.layers, self.controls = session, layers, controls
        server.scene.on_click()(self._click)

    def _click(self, event: Any) -> None:
        """Throw or tie, where a click points."""
        origin, direction = np.array(event.ray_origin, float), np.array(event.ray_direction, float)
        tool = self.controls.tool.value
        if tool == "throws a sphere":
            self._throw(origin, direction)
        elif tool == "ties a string":
            self.session.ask(lambda playground: self._tie(playground, origin, direction), touch=Touch.TIES)

    def _throw(self, origin: np.ndarray, direction: np.ndarray) -> None:
        """Throw a sphere from before the camera to the place that the click points at.

        It is drawn at once, and simulated as soon as possible.
        """
        picture, size = self.session.picture, self.session.playground.size
        points, scene = np.concatenate(picture.frame.points), picture.scene
        radius = self.controls.radius.value * size
        on_balloon = hit_distance(origin, direction, points, self.layers.drawing.all_triangles)
        on_obstacle = self.layers.obstacles.hit_distance(origin, direction)
        hit = min((each for each in (on_balloon, on_obstacle) if each is not None), default=None)
        if hit is None and scene.ground:
            hit = ground_distance(origin, direction, scene.up, scene.ground.height)
        if hit is None:
            hit = float((points.mean(axis=0) - origin) @ direction)
        target = origin + hit * direction
        start = origin + max(hit - 1.2 * size - radius, NEAREST * hit) * direction
        if scene.ground:  # not from below it
            up = np.array(scene.up)
            start = start + max(scene.ground.height + 1.01 * radius - start @ up, 0.0) * up
        velocity = throw_at(target, start, self.controls.throw_speed.value * size, scene.gravity, scene.up)
        mass = float(self.controls.mass.value)
        self.session.ask(lambda playground: playground.throw(start, velocity, radius, mass), touch=Touch.THROWS)
        color = colors.sphere_color(len(self.session.playground.journal.spheres), None)
        self.layers.draw_pending_sphere(start, radius, color, self.session.asked)

    def _tie(self, playground: Playground, origin: np.ndarray, direction: np.ndarray) -> None:
        """Tie a string from the ground, or from below, to the particle that the click points at."""
        scene, points = playground.live, playground.points
        hit = hit_distance(origin, direction, points, self.layers.drawing.all_triangles)
        if hit is None:
            raise InputError("click on a balloon to tie a string to it")
        particle = nearest_particle(points, origin + hit * direction)
        up, place = np.array(scene.up), points[particle].astype(float)
        drop = place @ up - scene.ground.height if scene.ground else playground.size
        playground.tie(particle, place - max(drop, 0.1 * playground.size) * up)


async def drag(session: Session, event: Any) -> None:
    """Pull at the particle where a drag began."""
    who, phase = event.client_id, event.phase
    start, place = np.array(event.start_position, float), np.array(event.end_position, float)
    if phase == "start":
        session.ask(
            lambda playground: playground.grab(who, nearest_particle(playground.points, start), place), touch=Touch.TIES
        )
    elif phase == "update":
        session.ask(lambda playground: playground.pull(who, place), key=("pull", who), touch=Touch.TIES)
    else:
        session.ask(lambda playground: playground.release(who), touch=Touch.RELEASES)
