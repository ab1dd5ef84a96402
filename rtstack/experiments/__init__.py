"""The engine of experiments: a specification gives cases, workers make rows of them, and rows give a report.

The kinds of experiments are plug-ins: see `experiment` for what one is, and `registry` for how one is found.
"""
