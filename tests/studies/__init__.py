"""Campaigns that measure this project itself, as plug-ins of the engine of experiments."""
