"""Tells a person elsewhere what a campaign waits for, and how it ended: a POST of JSON to an address of theirs."""

import json
import sys
import urllib.request
from dataclasses import dataclass
from urllib.parse import urlsplit

from rtstack.trials.errors import TrialError

TIMEOUT_S = 5.0


@dataclass(slots=True)
class Webhook:
    """url: http or https; campaign: its name. What does not arrive is said on stderr, once, and ends nothing."""

    url: str
    campaign: str
    _said: bool = False

    def __post_init__(self) -> None:
        parts = urlsplit(self.url)
        if parts.scheme not in ("http", "https") or not parts.netloc:
            raise TrialError(f"--webhook {self.url}: give an address such as https://chat.example/hooks/1")

    def __call__(self, event: str, text: str) -> None:
        """Send one event: waiting, stopped or ended; and one line that says what."""
        body = json.dumps({"campaign": self.campaign, "event": event, "text": f"{self.campaign}: {text}"}).encode()
        request = urllib.request.Request(self.url, body, {"Content-Type": "application/json"})
        try:
            urllib.request.urlopen(request, timeout=TIMEOUT_S).close()
        except OSError as error:
            if not self._said:
                print(f"rtstack: warning: --webhook {self.url}: {error}", file=sys.stderr)
            self._said = True
