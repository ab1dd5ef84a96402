"""Review of logs: columns on disk, what a page or a program asks of them, and a scene that follows a cursor."""
