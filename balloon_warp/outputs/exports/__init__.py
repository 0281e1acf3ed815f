"""A stage as files of other kinds."""

from balloon_warp.outputs.exports.export import EXPORT_SUFFIXES, HDF5_SUFFIXES, check_export, export_stage

__all__ = ["EXPORT_SUFFIXES", "HDF5_SUFFIXES", "check_export", "export_stage"]
