"""Timing of a stage's frames, whole time codes at which something is sampled, and an open shutter.

Stages of other programs count time in seconds, in 4,800 codes a second, or between codes. Such a stage is looked at
through another one whose time codes are its frames: USD scales the time of a sublayer by the two rates.
"""

import math
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom

from balloon_warp.errors import InputError

SLOWEST, FASTEST = 8.0, 240.0
"""Range of the frame rate of a stage whose time codes are frames [1/s]"""
USUAL_RATE = 24.0
"""Frame rate of a stage that has none [1/s]"""
NEAR = 1e-3
"""Largest distance of a sample from a frame to count as there [frames]"""
EARLIER = 1e-6
"""Shift of samples, so that rounding leaves none behind its frame [frames]"""


class Timing(NamedTuple):
    """A stage whose frames are whole time codes."""

    stage: Usd.Stage
    first: int
    """Number of the first frame"""
    last: int
    """Number of the last frame"""
    rate: float
    """Frame rate [1/s]"""


def timing_of(stage: Usd.Stage, path: Path) -> Timing:
    """Find the frames of a stage: its samples within the range that it says, at their own times.

    Raises:
        InputError: the rate is not positive, or the range is not finite or not in order.
    """
    rate, frame_rate = stage.GetTimeCodesPerSecond(), stage.GetFramesPerSecond()
    if not 0.0 < rate < math.inf:
        raise InputError(f"{path}: its timeCodesPerSecond is {rate:g}; expected a rate above 0")
    attributes = [attribute for prim in stage.Traverse() for attribute in prim.GetAttributes()]
    samples = np.array(Usd.Attribute.GetUnionedTimeSamples(attributes))
    begin, end = _range(stage, path, samples)
    samples = samples[(samples >= begin) & (samples <= end)]
    whole = np.abs(samples - np.round(samples)).max(initial=0.0) < NEAR
    if whole and (SLOWEST <= rate <= FASTEST or len(samples) < 2):
        first = math.ceil(begin)
        # Where no whole frame is between them, the next one shows the state of the last time code.
        return Timing(stage, first, max(first, math.floor(end)), rate)
    frames = _frame_rate(samples, rate, frame_rate if 0.0 < frame_rate < math.inf else USUAL_RATE)
    begin = float(samples[0]) if len(samples) else begin
    count = math.floor((end - begin) / rate * frames + NEAR)
    return Timing(_seen_through(stage, frames, -begin / rate * frames - EARLIER), 0, count, frames)


def _range(stage: Usd.Stage, path: Path, samples: NDArray[np.float64]) -> tuple[float, float]:
    """Return the first and the last time code: those samples in the stage's range.

    All samples where the range has none, or is missing; one where nothing moves.
    """
    spans = (float(samples[0]), float(samples[-1])) if len(samples) else (0.0, 0.0)
    if not stage.HasAuthoredTimeCodeRange():
        return spans
    start, end = stage.GetStartTimeCode(), stage.GetEndTimeCode()
    if not -math.inf < start <= end < math.inf:
        raise InputError(f"{path}: its time codes go from {start:g} to {end:g}; expected finite ones, in order")
    if len(samples) < 2:
        only = max(start, min(end, spans[0])) if len(samples) else start
        return only, only
    begin, last = max(start, spans[0]), min(end, spans[1])
    return (begin, last) if begin <= last else spans


def _frame_rate(samples: NDArray[np.float64], rate: float, usual: float) -> float:
    """Return a frame rate at which all samples are frames, the usual or more; the usual where there is none.

    Args:
        samples: time codes, ascending.
        rate: time codes a second.
        usual: frames a second.
    """
    if len(samples) < 2:
        return usual
    shortest = float(np.diff(samples).min())
    steps = (samples - samples[0]) / shortest
    own = round(rate / shortest, 9)
    if np.abs(steps - np.round(steps)).max() > NEAR or own > FASTEST:
        return usual
    return own * max(1, round(usual / own)) if own < SLOWEST else own


def _seen_through(stage: Usd.Stage, rate: float, offset: float) -> Usd.Stage:
    """Return a stage with another rate of time codes and an offset, with the same prims at the same seconds."""
    root, layer = stage.GetRootLayer(), Sdf.Layer.CreateAnonymous(".usda")
    layers = [stage.GetSessionLayer(), root]
    layer.timeCodesPerSecond = layer.framesPerSecond = rate
    for number, each in enumerate(layers):
        layer.subLayerPaths.append(each.identifier)
        layer.subLayerOffsets[number] = Sdf.LayerOffset(offset, 1.0)
    layer.customLayerData = root.customLayerData
    seen = Usd.Stage.Open(layer)
    UsdGeom.SetStageUpAxis(seen, UsdGeom.GetStageUpAxis(stage))
    UsdGeom.SetStageMetersPerUnit(seen, UsdGeom.GetStageMetersPerUnit(stage))
    return seen


MOMENTS = 8
"""Number of moments within the shutter time"""


def moments(frame: int, shutter: float, last_frame: int) -> list[float]:
    """Return evenly spaced times within the shutter time, which begins at the frame, or ends at the last one.

    Args:
        shutter: how long that is, in frames.
    """
    if shutter == 0.0:
        return [frame]
    begin = min(float(frame), last_frame - shutter)
    return [begin + shutter * (number + 0.5) / MOMENTS for number in range(MOMENTS)]


def one_over_the_other(pictures: Iterable[NDArray[np.uint8]]) -> NDArray[np.uint8]:
    """Return the mean of pictures, as light adds up; clear pixels add no light."""
    several = list(pictures)
    total = np.zeros(1)
    for picture in several:
        light = LINEAR[picture[..., :3]]
        cover = picture[..., 3:] / 255.0 if picture.shape[2] == 4 else np.ones((1, 1, 1))
        total = total + np.concatenate([light * cover, np.broadcast_to(cover, (*light.shape[:2], 1))], axis=2)
    light = total[..., :3] / np.maximum(total[..., 3:], 1e-9)
    shown = np.searchsorted(_STEPS, light).astype(np.uint8)
    if several[0].shape[2] == 3:
        return shown
    return np.concatenate([shown, np.rint(255.0 * total[..., 3:] / len(several)).astype(np.uint8)], axis=2)


def _linear(encoded: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return the inverse of sRGB's transfer function."""
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


LINEAR = _linear(np.arange(256) / 255.0)
"""Linear light of each byte of sRGB"""
_STEPS = _linear((np.arange(255) + 0.5) / 255.0)
