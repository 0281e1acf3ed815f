"""Motion of a part from frame to frame."""

import numpy as np
from bpy.types import Depsgraph, Object

from . import properties
from .parts import Part, mesh_points
from .snapshot import RIGID, RefusedError, Thing, in_world, is_rigid


class Motion:
    """Places and shape of a part, frame by frame.

    Args:
        thing: the part at the start, which gets its motion in the end.
    """

    def __init__(self, thing: Thing):
        self._thing = thing
        self._places: list[np.ndarray] = []
        self._shapes: list[np.ndarray] = []
        self._anchors: list[np.ndarray] = []
        self._amounts: list[float] = []

    def add(self, part: Part, graph: Depsgraph) -> None:
        """Note the part in the next frame.

        Raises:
            RefusedError: its mesh has another number of vertices than at the start.
        """
        thing, settings = self._thing, properties.of(part.original)
        self._places.append(part.place)
        self._amounts.append(getattr(properties.of(part.evaluated), properties.amount_of(thing.settings["inflate"])))
        if settings.string:
            self._anchors.append(place_of(settings.string, graph))
        if thing.role == "OBSTACLE" or len(thing.pinned):
            points = mesh_points(part.evaluated)
            if points.shape != thing.points.shape:
                raise RefusedError(
                    f"{thing.name}: has {len(points)} vertices in a later frame; expected {len(thing.points)}, as at "
                    "the start"
                )
            same = np.abs(points - thing.points).max() <= RIGID * np.ptp(thing.points)
            self._shapes.append(thing.points if same and thing.role == "OBSTACLE" else points)

    def finish(self) -> None:
        """Give the thing its motion.

        Raises:
            RefusedError: it has no size in a frame.
        """
        thing = self._thing
        thing.places = changing(np.array(self._places))
        thing.amounts = changing(np.array(self._amounts)).tolist()
        thing.anchors = changing(np.array(self._anchors)) if self._anchors else None
        stays = all(shape is thing.points for shape in self._shapes)
        if thing.role == "OBSTACLE" and not (stays and is_rigid(thing.places)):
            thing.pinned = np.arange(len(thing.points))
        elif thing.role != "OBSTACLE":
            for place in thing.places:
                require_size(thing.name, place)
        if len(thing.pinned):
            pairs = zip(self._shapes, self._places, strict=True)
            thing.paths = changing(np.array([in_world(shape[thing.pinned], place) for shape, place in pairs]))


def require_size(name: str, place: np.ndarray) -> None:
    """Make sure that an object has a size.

    Raises:
        RefusedError: it has not.
    """
    if np.linalg.matrix_rank(place[:3, :3]) < 3:
        raise RefusedError(f"{name}: has a scale of 0; expected another along each axis")


def place_of(thing: Object, graph: Depsgraph) -> np.ndarray:
    """Return the place of an object in the world."""
    return np.array(thing.evaluated_get(graph).matrix_world.translation, np.float64)


def changing(values: np.ndarray) -> np.ndarray:
    """Return values of frames, or the first alone where all are alike."""
    return values if (values != values[:1]).any() else values[:1]
