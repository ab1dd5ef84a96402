"""The engine of experiments: a specification gives cases, workers make rows of them, and rows give a report."""
