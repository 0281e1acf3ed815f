"""Directions of normal forces backwards: from the bars of particles' directions to those of their places."""

from typing import Any

import warp as wp

from balloon_warp.kernels.adjoints.directions import DirectionBars, add_up_totals, gather_from_faces, hand_on_to_faces
from balloon_warp.launching import launch, launch_tiled
from balloon_warp.model import Model
from balloon_warp.model.memory import Room
from balloon_warp.schedules.launches import team_threads


class DirectionsBackward:
    """Run the directions of normal forces backwards: once a frame, or every substep.

    Args:
        working: of the launches that compute frames again; particles leave the bars of their directions there.
        point_bars: by where particles are, to which is added.
    """

    def __init__(self, model: Model, tables: Any, working: Any, point_bars: wp.array, room: Room):
        self._model, self._tables, self._working, self._point_bars = model, tables, working, point_bars
        particles, balloons = (model.world_count, model.particle_count), (model.world_count, model.balloon_count)
        working.direction_bars = room.array(particles, wp.vec3)
        self._bars = DirectionBars()
        self._bars.of_sums, self._bars.nearest = room.array(particles, wp.vec3), room.array(particles, wp.int32)
        self._bars.of_areas, self._bars.of_totals = (room.array(particles, wp.float32) for _ in range(2))
        self._bars.totals = room.array(balloons, wp.float32)

    def turn_back(self, points: wp.array, areas: wp.array) -> None:
        """Turn the bars of directions into those of points.

        Args:
            points: from which the directions were found.
            areas: of balloons then [m^2].
        """
        model, bars = self._model, self._bars
        places, device = (model.world_count, model.particle_count), model.device
        launch(hand_on_to_faces, places, [self._tables, self._working, points, areas, bars], device=device)
        balloons, threads = (model.world_count, model.balloon_count), team_threads(model)
        launch_tiled(add_up_totals, dim=balloons, inputs=[self._tables, bars], block_dim=threads, device=device)
        launch(gather_from_faces, places, [self._tables, points, bars, self._point_bars], device=device)
