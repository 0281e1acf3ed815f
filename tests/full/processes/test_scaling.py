"""Weak scaling over processes that simulate at the same time."""

import time

import pytest
import warp as wp

from balloon_warp.benchmarks import scaling
from balloon_warp.benchmarks.cases import Case
from balloon_warp.benchmarks.scaling import CPU_SHARE, GPU_SHARE, Share, measure_scaling
from balloon_warp.errors import InputError, WorkersLostError

SMALL = Share("cpu", Case("8 balloons", "lanes", 8, cells=3), frames=5)


def test_two_processes_simulate_a_share_each(monkeypatch: pytest.MonkeyPatch):
    began = time.perf_counter()
    (result,) = measure_scaling(SMALL, [2])
    work = 2 * 8 * 56 * 32 * SMALL.frames
    assert (result.case, result.worlds, result.particles) == ("8 balloons x 2", 16, 56)
    assert result.ratio == pytest.approx(1.0)  # the others are compared with the first count
    assert 0.0 < work / result.rate < time.perf_counter() - began


def test_the_ratio_is_the_efficiency(monkeypatch: pytest.MonkeyPatch):
    rates = {1: 100.0, 2: 190.0, 4: 300.0}
    monkeypatch.setattr(scaling, "_rate_together", lambda share, environments: (rates[len(environments)], 56))
    results = list(measure_scaling(SMALL, [1, 2, 4]))
    assert [result.ratio for result in results] == [1.0, 0.95, 0.75]
    assert [result.worlds for result in results] == [8, 16, 32]


def test_the_time_is_from_the_first_start_to_the_last_end():
    told = [(56, [(0.0, 1.0), (5.0, 6.5)]), (56, [(0.2, 1.5), (4.5, 6.0)])]
    assert scaling.spans_together(told) == [1.5, 2.0]


def test_a_process_that_fails_ends_the_others_too(capfd: pytest.CaptureFixture[str]):
    unstable = Share("cpu", Case("", "lanes", 8, cells=3, substeps=1), frames=1)
    with pytest.raises(WorkersLostError, match="a process of the benchmark failed"):
        list(measure_scaling(unstable, [2]))
    assert "substeps: 1 are too few" in capfd.readouterr().err


def test_each_process_sees_a_gpu_of_its_own(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.delenv("CUDA_VISIBLE_DEVICES", raising=False)
    monkeypatch.setattr(wp, "get_cuda_device_count", lambda: 2)
    seen = []
    monkeypatch.setattr(scaling, "_rate_together", lambda _, environments: (float(seen.append(environments) or 1), 1))
    list(measure_scaling(GPU_SHARE, [1, 2]))
    assert seen == [[{"CUDA_VISIBLE_DEVICES": "0"}], [{"CUDA_VISIBLE_DEVICES": "0"}, {"CUDA_VISIBLE_DEVICES": "1"}]]
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "3,5")
    list(measure_scaling(GPU_SHARE, [2]))
    assert seen[-1] == [{"CUDA_VISIBLE_DEVICES": "3"}, {"CUDA_VISIBLE_DEVICES": "5"}]
    with pytest.raises(InputError, match=r"^gpus 4: this machine has 2$"):
        list(measure_scaling(GPU_SHARE, [1, 4]))


@pytest.mark.parametrize("counts", [[], [0], [2, -1]])
def test_counts_below_one_are_refused(counts: list[int]):
    with pytest.raises(InputError, match=r"^--workers: expected numbers of at least 1"):
        list(measure_scaling(CPU_SHARE, counts))
