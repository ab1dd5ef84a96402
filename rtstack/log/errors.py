"""What can go wrong with a log. Every message is one clear line."""


class LogError(Exception):
    """A log cannot be written, read or recovered: the message names the file and says why."""
