"""The gradient of a bounce is the slope of what it derives."""

import numpy as np
import pytest

from balloon_warp.benchmarks.gradient_bounce import slope_and_gradients


def test_the_gradient_of_a_bounce_is_the_slope_over_many():
    """A ball's height by its speed before: the mean gradient of 17 worlds is the slope over them within 1.5 %, three
    times what their deviation of 1.6 % makes of the mean. It was a fifth off while a step stopped all of an approach,
    whenever in the step the ground was met: those jumps carried the rest of the slope."""
    slope, gradients = slope_and_gradients("ground", 0.0, worlds=17)
    assert np.std(gradients) < 0.05 * abs(slope)
    assert np.mean(gradients) == pytest.approx(slope, rel=0.015)
