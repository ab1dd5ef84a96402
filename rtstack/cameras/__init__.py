"""Cameras of a cell: each in a process of its own beside the log's, so that no picture delays a tick."""
