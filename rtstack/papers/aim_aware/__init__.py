"""The planar study of the collision-monitoring paper: simulations, tuning, classification, report."""
