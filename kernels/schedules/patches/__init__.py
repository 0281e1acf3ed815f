"""Blocks that have a part of a large world each, and exchange its rim."""
