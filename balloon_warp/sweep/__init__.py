"""Many worlds at once: their varied values, and their measures."""
