"""What the implicit solver needs."""
