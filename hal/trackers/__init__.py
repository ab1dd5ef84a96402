"""Drivers of motion-capture systems and tag cameras."""
