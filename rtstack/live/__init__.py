"""The running stack: supervisor, robot process, and what other processes say to it."""
