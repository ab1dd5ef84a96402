"""Quantities computed from a log."""
