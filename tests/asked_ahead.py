"""Stand-in for the process that compiles ahead."""

from collections.abc import Sequence

from balloon_warp.kernels.laws import Law
from balloon_warp.scene import Scene
from balloon_warp.viewer.ahead import Ahead


class AskedAhead(Ahead):
    """Stand-in that records the scenes to compile and compiles none, as test_view_parts.py does: on a machine of two
    cores compilation would take time that the page itself lacks."""

    def __init__(self) -> None:
        super().__init__()
        self.scenes: list[Scene] = []

    def begin(self, scene: Scene, device: str, laws: Sequence[Law] = ()) -> None:
        self.scenes.append(scene)
