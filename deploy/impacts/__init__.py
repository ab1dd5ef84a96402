"""Scenes of impacts, for `rtstack impact-map`."""
