"""Contact of balloons: search for pairs, and response."""
