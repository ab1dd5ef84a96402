"""The operator console: one signed-in page over the live rings, the robot process's socket and the logs."""
