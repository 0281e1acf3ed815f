"""Parameters that follow from others, once some have changed."""

from collections.abc import Sequence

import numpy as np

from balloon_warp.model.materials import settle_masses
from balloon_warp.model.obstacles import settle_friction
from balloon_warp.model.parameters import Parameters
from balloon_warp.model.shape import BalloonShape
from balloon_warp.model.touch import settle_touch
from balloon_warp.scene import Scene


def follow_changes(scene: Scene, shapes: Sequence[BalloonShape], now: Parameters, then: Parameters) -> None:
    """Set in `then` the parameters that follow from values that differ from those in `now`.

    These are masses of rubber and film, the contact stiffness of balloons, and coefficients of friction. One that has
    been written over stays so while those that it follows from stay.
    """
    for settle in (
        lambda values: {"mass": settle_masses(scene, shapes, values)},
        lambda values: settle_touch(scene, shapes, values),
        settle_friction,
    ):
        before, after = settle(now), settle(then)
        then.update({name: values for name, values in after.items() if not np.array_equal(values, before[name])})
