"""What a machine needs for two arms, what it has of that, and what it costs where something is missing."""
