"""The command line: `balloon-warp COMMAND`. No logic here; each command calls the package and prints."""

from balloon_warp.cli.app import main

__all__ = ["main"]
