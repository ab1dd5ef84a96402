"""Other people's viewers of our logs: how Rerun and Foxglove are to arrange what a log shows them by itself."""
