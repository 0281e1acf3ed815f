"""What changes in a scene when somebody inflates it by hand."""

from typing import Any

from balloon_warp.scene import Scene
from balloon_warp.scene.overrides import override_scene
from balloon_warp.scene.schema.inflation import BLOWN


def inflating(scene: Scene, value: float) -> list[tuple[str, Any]]:
    """Paths and values for what is keyframed of all balloons that are inflated as the first one is.

    What the scene itself would go on to blow in does not come any more.

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
