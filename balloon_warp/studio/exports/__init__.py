"""A stage as files of other kinds."""

from balloon_warp.studio.exports.export import (
    EXPORT_SUFFIXES,
    HDF5_SUFFIXES,
    check_export,
    export_stage,
    files_of_frames,
)

__all__ = ["EXPORT_SUFFIXES", "HDF5_SUFFIXES", "check_export", "export_stage", "files_of_frames"]
