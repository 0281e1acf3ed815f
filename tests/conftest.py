"""What all tests share."""

import pytest
import warp as wp

wp.config.log_level = wp.LOG_ERROR


@pytest.fixture(params=["cpu", "cuda:0"])
def device(request: pytest.FixtureRequest) -> str:
    """Each device; the GPU's tests skip themselves where there is none."""
    if request.param != "cpu" and not wp.is_cuda_available():
        pytest.skip("needs a GPU")
    return request.param
