"""Runs of one scene side by side, with other values: one picture, one table."""
