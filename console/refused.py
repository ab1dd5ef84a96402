"""What the console does not do, for a reason that a person can read."""


class Refused(Exception):
    """A request that is refused. The message is one line that says why; `status` is the one of HTTP."""

    def __init__(self, status: int, reason: str) -> None:
        super().__init__(reason)
        self.status = status
