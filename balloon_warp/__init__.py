"""Balloon simulation on NVIDIA Warp: any mesh in, animated USD out."""

from pathlib import Path

# In a source tree kernels/ and scenes/ stand beside this folder; an installed package has them inside.
if not (Path(__file__).parent / "kernels").is_dir():
    __path__.append(str(Path(__file__).parent.parent))
