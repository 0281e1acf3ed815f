"""Former name of `balloon_warp.learn`, for one release."""

import warnings

import balloon_warp.learn
from balloon_warp.learn import *  # noqa: F403

warnings.warn("balloon_warp.envs is balloon_warp.learn now", FutureWarning, stacklevel=2)
__path__ = balloon_warp.learn.__path__
