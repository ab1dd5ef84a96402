"""A campaign on a cell's arms: in which order, how the object gets to its place, what became of each attempt."""
