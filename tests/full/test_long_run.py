"""Memory over long runs, briefly: it does not grow, and a leak is found."""

from dataclasses import replace

import pytest

from balloon_warp.benchmarks.long_run import CASES, QUICK, Growth, measure

BATCH = QUICK[-1]


@pytest.mark.parametrize("case", QUICK, ids=lambda case: case.name)
def test_memory_does_not_grow(case):
    growth = measure(case)
    assert growth.marks[-1][0] == case.frames
    assert growth.is_bounded, f"{growth.slope:.2f} MiB in {case.units}"


def test_frames_that_are_kept_are_seen():
    growth = measure(replace(BATCH, save_bytes=1 << 40))
    assert not growth.is_bounded
    assert growth.slope == pytest.approx(3.5, abs=1.0)  # 36 bytes of each of 1,016 particles


@pytest.mark.parametrize(("per_thousand", "bounded"), [(0.0, True), (0.7, True), (1.5, False), (20.0, False)])
def test_a_slope_is_found_beside_the_rise_and_fall_of_what_is_saved(per_thousand: float, bounded: bool):
    """A leak of more than 1 MiB in 1,000 frames is found beside 64 MiB that rise and fall each 2,700 frames."""
    frames = range(0, 10_001, 50)
    marks = [(frame, 90.0 + frame % 2700 / 2700 * 64.0 + per_thousand * frame / 1000) for frame in frames]
    growth = Growth(CASES[1], marks, 0.0)
    # The highest marks are 2,700 frames apart, of stretches of 3,000.
    assert growth.slope == pytest.approx(per_thousand, rel=0.15, abs=0.01)
    assert growth.is_bounded is bounded
