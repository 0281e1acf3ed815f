"""Files of a world each, with all that moved in it: for learning.

world_file   what stands in such a file
hdf5         as HDF5, by h5py
zarr         as a Zarr store of version 2, which needs nothing
npz          as NumPy has it

All moving arrays have fixed places: frames may come in any order, and the same frames give the same bytes.
"""

from balloon_warp.outputs.world_files.formats import FORMATS, Format, format_named
from balloon_warp.outputs.world_files.world_file import Field, Slot, WorldFile

__all__ = ["FORMATS", "Field", "Format", "Slot", "WorldFile", "format_named"]
