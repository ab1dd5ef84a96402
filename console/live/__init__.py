"""What the console knows of the running robot process."""
