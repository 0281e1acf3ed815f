"""A batch: many worlds of a scene at once, on this machine; their varied values, tables and files."""
