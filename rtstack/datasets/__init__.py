"""Logs as data sets for learning code: one module a format, behind rtstack.datasets.export."""
