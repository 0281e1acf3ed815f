"""Run-specific parts of checkpoints: description, folder, and output."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

from balloon_warp.blow_ups import MOST_HALVINGS
from balloon_warp.files import target_of
from balloon_warp.frame import Frame
from balloon_warp.model.strain_bound import strain_bound_described
from balloon_warp.provenance import describe_simulation
from balloon_warp.resume.folder import PartialFolder
from balloon_warp.resume.part import Part
from balloon_warp.resume.same_job import as_json
from balloon_warp.simulator import Simulator

if TYPE_CHECKING:
    from balloon_warp.outputs.usd import StageWriter


@dataclass(frozen=True)
class RunOutput:
    """Output of a run: a stage, and no rows."""

    stage: "StageWriter"

    def write(self, frame: Frame) -> None:
        """Write the next frame."""
        self.stage.write(frame)

    def rows(self, part: Part) -> Mapping[str, NDArray]:
        """Return nothing: all is in the stage."""
        return {}

    def take_rows(self, part: Part, saved: Mapping[str, NDArray]) -> None:
        """Take nothing."""


def partial_path(output: Path) -> Path:
    """Name the folder of a run that is not finished, beside its output, or beside the target of links there."""
    target = target_of(output)
    return target.with_name(f"{target.name}.partial")


def halvings_until(folder: Path, substeps: int) -> int:
    """Return how often an unfinished run had restarted with half the step.

    Args:
        folder: Folder of its checkpoints.
        substeps: Original number of substeps; where no halving fits it, it is another run, and 0 is returned.
    """
    reached = (PartialFolder(folder).job() or {}).get("substeps")
    halves = [substeps * 2**halvings for halvings in range(MOST_HALVINGS + 1)]
    return halves.index(reached) if reached in halves else 0


def describe_run(simulator: Simulator) -> dict[str, Any]:
    """Describe the inputs that decide a run's bits, for JSON. Before the run: mesh files may change meanwhile."""
    model = simulator.model
    done_by = {
        "strain_bound": strain_bound_described(model),
        "schedule": simulator.schedule.name,
        "device": model.device.name if model.device.is_cuda else "cpu",
    }
    return as_json(describe_simulation(model.scene, model.own_laws, model.substeps) | done_by)
