"""Files of a world each, with all that moved in it: for learning.

world_file   the contents of such a file
frames       frames as they come, before they go into one
packing      how arrays are cut and compressed
hdf5         as HDF5, by h5py
zarr         as a Zarr store of version 2, which needs nothing
npz          as NumPy has it

Frames may come in any order, and the same frames give the same bytes.
"""

from balloon_warp.outputs.world_files.formats import FORMATS, Field, FileContents, Format, WorldFile, format_named

__all__ = ["FORMATS", "Field", "FileContents", "Format", "WorldFile", "format_named"]
