"""The controller's own model of an arm. It never sees the plant's parameters."""
