"""Benchmark of gradients beside Newton's."""

import numpy as np
import pytest


def test_newton_gives_the_same_gradient():
    """Derivatives through the same springs agree to 1e-3 of the largest: both are float32, over 32 substeps."""
    pytest.importorskip("newton")
    from balloon_warp.benchmarks.newton_gradients import Case

    case = Case("springs", 1, 1, "cpu")
    ours, its = case.ours().gradient(), case.newton().gradient()
    assert np.abs(ours).max() > 0.0
    np.testing.assert_allclose(its, ours, rtol=1e-3, atol=1e-3 * np.abs(ours).max())
