"""What is wrong with a request, in one line that says what to do."""


class TrialError(Exception):
    """Bad input: the trial was not begun, and nothing was written."""
