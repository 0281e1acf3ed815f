"""Touches: actions of a hand on a scene, and the kinds of things that a scene has after each."""

from enum import Enum

from balloon_warp.scene import Scene

Kinds = frozenset[str]
"""Kinds of things that have kernels of their own and that a hand may bring: spheres, strings and wind"""
REASON: Kinds = frozenset({"reason"})
"""Kind, beside those of a scene, of the kernels that find the reason of its blow-up"""


class Touch(Enum):
    """Ways to touch a scene; each has the kind of things that it brings or takes, and whether it brings them."""

    SETS = "", True
    THROWS = "sphere", True
    TIES = "string", True
    RELEASES = "string", False
    CUTS = "strings", False
    BLOWS = "wind", True

    @property
    def line(self) -> str:
        """Line in which touches wait for each other: a hand lets go after it took hold."""
        return self.value[0].rstrip("s")

    def leaves(self, scene: Scene) -> Kinds:
        """Return the kinds of things in a scene after this touch."""
        there, (kind, brings) = kinds_of(scene), self.value
        if brings:
            return there | {kind} if kind else there
        return there if kind == "string" and len(scene.string) > 1 else there - {"string"}


def kinds_of(scene: Scene) -> Kinds:
    """Return the kinds of things in a scene that a hand may bring."""
    there = {"sphere": scene.sphere, "string": scene.string, "wind": any(scene.atmosphere.wind)}
    return frozenset(kind for kind, some in there.items() if some)
