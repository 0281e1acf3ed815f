"""Python, files, streams and Warp as the package uses them: no physics here."""
