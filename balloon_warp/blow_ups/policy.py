"""Policies for a run, or a world of a batch, that blows up."""

from balloon_warp.errors import InputError
from balloon_warp.scene import Scene

POLICIES = ("freeze", "stop", "restart")
"""Policies: keep the last good frame; end everything; restart with half the step"""
MOST_HALVINGS = 4
"""Largest number of halvings of a step before giving up: 16 times the substeps"""


def check_policy(on_blowup: str) -> None:
    """Check the name of a policy.

    Raises:
        InputError: there is not.
    """
    if on_blowup not in POLICIES:
        raise InputError(f"on_blowup {on_blowup}: expected {', '.join(POLICIES)}")


def with_half_the_step(scene: Scene, substeps: int) -> Scene:
    """Return the scene with twice its substeps, now and wherever it changes them.

    Args:
        substeps: that it has at the start, in a frame.
    """
    changes = []
    for change in scene.change:
        later = change.set.get("substeps")
        doubled = {**change.set, "substeps": 2 * later} if isinstance(later, int) else change.set
        changes.append(change.model_copy(update={"set": doubled}))
    return scene.model_copy(update={"substeps": 2 * substeps, "change": changes})
