"""A simulation as an animated USD stage."""

from balloon_warp.usd.stage import STAGE_SUFFIXES, StageWriter

__all__ = ["STAGE_SUFFIXES", "StageWriter"]
