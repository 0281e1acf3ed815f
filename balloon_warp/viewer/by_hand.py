"""Changes of a scene by inflating it by hand, or by wind."""

from typing import Any

from balloon_warp.scene import Scene
from balloon_warp.scene.overrides import override_scene
from balloon_warp.scene.schema.inflation import BLOWN

SPHERE_DRAG = 0.47


def inflating(scene: Scene, value: float) -> list[tuple[str, Any]]:
    """Return paths and values for the keyframed field of all balloons that are inflated as the first one is.

    The scene's own filling ends.

    Raises:
        InputError: a balloon has a pump's curve, which holds for all time.
    """
    kind, changes = scene.balloon[0].inflation.kind, []
    for number, balloon in enumerate(scene.balloon):
        if balloon.inflation.kind == kind:
            given = f"balloon.{number}.inflation"
            changes += [(f"{given}.{field}", 0.0) for field in BLOWN if getattr(balloon.inflation, field)]
            changes.append((f"{given}.{balloon.inflation.keyframed}", value))
    override_scene(scene, changes)  # all of it or nothing
    return changes


def blowing(scene: Scene, wind: list[float]) -> list[tuple[str, Any]]:
    """Return paths and values for a wind [m/s].

    Balloons without any drag in air get a sphere's, or they would not feel it.
    """
    slippery = [number for number, balloon in enumerate(scene.balloon) if balloon.drag_coefficient == 0.0]
    drag = [(f"balloon.{number}.drag_coefficient", SPHERE_DRAG) for number in slippery]
    return [*drag, ("atmosphere.wind", wind)]
