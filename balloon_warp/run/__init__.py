"""A run: a scene to its stage, with checkpoints, blow-ups, outcomes and provenance."""
