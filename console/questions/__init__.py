"""Long questions to other processes, and their answers."""
