"""The arm study of the collision-monitoring paper: a simulated FR3 hits an inclined platform."""
