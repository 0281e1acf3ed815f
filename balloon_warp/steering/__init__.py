"""Values that enter and leave a simulation on its device, without the host: controls, observations, new starts."""

from balloon_warp.steering.controls import Controls
from balloon_warp.steering.observations import Observations
from balloon_warp.steering.starts import Starts

__all__ = ["Controls", "Observations", "Starts"]
