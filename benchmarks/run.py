"""Runs the cases."""

from collections.abc import Iterator

import warp as wp

from balloon_warp.benchmarks.cases import (
    CPU_CASES,
    GPU_CASES,
    AnyCase,
    Case,
    ContactCase,
    ExportCase,
    FirstFrameCase,
    ReadingCase,
)
from balloon_warp.benchmarks.crowd import CrowdCase
from balloon_warp.benchmarks.crowd_rate import measure_crowd
from balloon_warp.benchmarks.export import measure_export
from balloon_warp.benchmarks.first_frame import measure_first_frame
from balloon_warp.benchmarks.rate import measure_rate
from balloon_warp.benchmarks.reading import measure_reading
from balloon_warp.benchmarks.real_time import measure_real_time
from balloon_warp.benchmarks.result import Result
from balloon_warp.benchmarks.rubber import RubberCase


def run_cases(device: wp.Device, quick: bool = False) -> Iterator[Result]:
    """Each case's result, as soon as it is measured."""
    for case in GPU_CASES if device.is_cuda else CPU_CASES:
        if case.quick or not quick:
            yield run_case(case, device)


def run_case(case: AnyCase, device: wp.Device) -> Result:
    """Measure a case, and its peer in the same run."""
    match case:
        case Case() | ContactCase() | RubberCase():
            return measure_rate(case, device)
        case CrowdCase():
            return measure_crowd(case, device)
        case ExportCase():
            return measure_export(case, device)
        case FirstFrameCase():
            return measure_first_frame(case, device)
        case ReadingCase():
            return measure_reading(case, device)
        case _:
            return measure_real_time(case, device)
