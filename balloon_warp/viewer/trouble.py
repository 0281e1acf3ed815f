"""Sentence for a user on why a simulation blew up."""

from balloon_warp.blow_ups import BlowUp
from balloon_warp.errors import BlowUpError
from balloon_warp.scene import Scene


def sentence_of(failure: BlowUpError, scene: Scene) -> str:
    """Return the cause of a failure, as in "Too much pressure for these springs."."""
    skin = "this skin" if any(balloon.material.is_membrane for balloon in scene.balloon) else "these springs"
    report = failure.report
    if not isinstance(report, BlowUp):
        return "The simulation blew up."
    inflated = report.other is None or report.other.by == "inflation"  # else something pulled harder than its springs
    if report.is_sphere:
        return "Too hard a blow for this sphere."
    if report.pressure or report.limit_point or (inflated and _step_is_stable(report)):
        return f"Too much pressure for {skin}."
    return f"Too {'much force' if _step_is_stable(report) else 'few substeps'} for {skin}."


def _step_is_stable(report: BlowUp) -> bool:
    return report.stable_step is not None and 0.0 < report.step <= report.stable_step
