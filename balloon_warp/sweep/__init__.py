"""Many worlds at once: what differs between them, and what is read from them."""
