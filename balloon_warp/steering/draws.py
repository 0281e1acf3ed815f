"""Draws: numbers of the distributions from which starts take values."""

import zlib
from dataclasses import dataclass
from typing import Literal

import numpy as np

from balloon_warp.errors import InputError
from balloon_warp.steering.start_values import StartValue

Kind = Literal["uniform", "log_uniform", "normal"]
KINDS: tuple[Kind, ...] = ("uniform", "log_uniform", "normal")


@dataclass(frozen=True)
class Draw:
    """A number that is drawn for each episode."""

    path: str
    axis: int
    kind: int
    first: float
    second: float
    start: StartValue | None
    """Value that counts at the start alone; None where a control has it"""

    @property
    def number(self) -> int:
        """Number that tells its generator from others."""
        return zlib.crc32(f"{self.path}.{self.axis}".encode()) & 0x7FFFFFFF


def require_numbers(path: str, first: float, second: float, kind: str) -> None:
    """Make sure that a distribution can be drawn from.

    Raises:
        InputError: the kind is unknown, or its numbers cannot be.
    """
    if kind not in KINDS:
        raise InputError(f"{path}: kind must be one of {', '.join(KINDS)} (got {kind!r})")
    numbers = [first, second]
    if not all(isinstance(each, int | float | np.number) and np.isfinite(each) for each in numbers):
        raise InputError(f"{path}: must be drawn by finite numbers (got {first!r} and {second!r})")
    if (second < 0.0) if kind == "normal" else second < first:
        raise InputError(f"{path}: must be drawn from the least to the largest (got {first:g} and {second:g})")
    if kind == "log_uniform" and first <= 0.0:
        raise InputError(f"{path}: must be above 0 where its logarithm is uniform (got {first:g})")
