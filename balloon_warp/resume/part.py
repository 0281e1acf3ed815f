"""Part of a job's output that is whole files of their own: some frames of some of its groups."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

from numpy.typing import NDArray

if TYPE_CHECKING:
    from balloon_warp.outputs.usd.growing import GrowingStage


@dataclass(frozen=True)
class Part:
    """Part of a job."""

    frames: range
    groups: Sequence[int]
    """Numbers of the groups that are simulated one by one: of a run 0, of a batch its groups or its shares"""
    notes: Mapping[str, Any] = field(default_factory=dict)
    """Notes besides rows and shapes, as JSON"""


class Output(Protocol):
    """Output of a job, as far as checkpoints take parts of it."""

    @property
    def stage(self) -> "GrowingStage | None":
        """Stage that grows, if there is one."""

    def rows(self, part: Part) -> Mapping[str, NDArray]:
        """Return the contents of a part besides the stage, as arrays by name; files they refer to are safe then."""
        ...

    def take_rows(self, part: Part, saved: Mapping[str, NDArray]) -> None:
        """Put the arrays of a part that was saved in their places."""
