"""One arm that hits a platform: its references, and the loop that follows them. Whose arm it is, hal knows."""
