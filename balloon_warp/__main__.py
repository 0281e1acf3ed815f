"""`python -m balloon_warp` is `balloon-warp`."""

from balloon_warp.cli import main

main()
