"""The folder of logs: what is in it, what people say about it, what is kept."""
