"""Contact: who may touch whom, and what comes of it."""
