"""Command that writes files for Blender: the extension, or the script that dresses a stage as our pictures.

`python -m balloon_warp.blender balloon_warp.zip` and `python -m balloon_warp.blender studio_look.py`.
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from balloon_warp.blender.extension import PLATFORMS, write_extension, write_studio_look
from balloon_warp.errors import InputError


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the file, and return the exit status: 0, or 2 after a mistake, which gets a sentence."""
    parser = argparse.ArgumentParser(
        prog="python -m balloon_warp.blender",
        description="Build the extension for Blender 4.2 and later, which is a zip: drop it into Blender's window. "
        "Or write the script of the studio look: blender --python studio_look.py -- balloon.usdc",
    )
    parser.add_argument("file", type=Path, help="file to write: .zip for the extension, .py for the studio look")
    parser.add_argument(
        "--platform",
        action="append",
        metavar="NAME",
        help=f"platform whose wheels it has: {', '.join(PLATFORMS)}; may be given several times; this one if not given",
    )
    parser.add_argument(
        "--no-wheels",
        action="store_true",
        help="leave the wheels out: small, and its preferences name the Python of an environment with balloon-warp",
    )
    asked = parser.parse_args(arguments)
    try:
        if asked.file.suffix == ".py":
            print(f"wrote {write_studio_look(asked.file)}: blender --python {asked.file} -- balloon.usdc")
            return 0
        path = write_extension(asked.file, asked.platform, not asked.no_wheels)
    except InputError as mistake:
        print(mistake, file=sys.stderr)
        return 2
    print(f"wrote {path}: drop it into Blender's window")
    return 0


if __name__ == "__main__":
    sys.exit(main())
