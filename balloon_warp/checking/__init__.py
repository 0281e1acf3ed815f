"""Checks of written stages for interpenetration."""

from balloon_warp.checking.check import CheckReport, Crossing, check_stage

__all__ = ["CheckReport", "Crossing", "check_stage"]
