"""The planar arm of the collision-monitoring paper: plant, impact map, references, tracking law. All compiled."""
