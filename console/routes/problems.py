"""What every request may be answered with instead of what was asked for: one line, in one form."""

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class Problem:
    """Why it was not done: one line that says what to do."""

    error: str


_MEANINGS = {
    400: "the host name is not this console's, or the request is none",
    401: "not signed in: no session, and no valid bearer token",
    403: "another site's request, a change without the session's word, or a scope that may only look",
    404: "there is no such thing",
    409: "refused as things are now: no operator has control, another one has, a job runs, the log is not read yet",
    413: "the body is too long",
    422: "a value is missing or wrong; the line begins with its name",
    500: "a file beside the logs is broken; the line says which",
    503: "the robot process does not answer, or this machine has no descriptors or memory left",
    507: "the disk is full",
}


def problems(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """Return the documentation of these statuses, for a route or a router."""
    return {status: {"model": Problem, "description": _MEANINGS[status]} for status in statuses}


def attachment(name: str) -> dict[str, str]:
    """Return the header by which a browser saves an answer under a name."""
    plain = name.encode("ascii", "replace").decode().replace('"', "'")
    return {"content-disposition": f'attachment; filename="{plain}"'}


def file_of(*media_types: str) -> dict[int | str, dict[str, Any]]:
    """Return the documentation of an answer that is a file, of one of these types."""
    return {200: {"content": {kind: {"schema": {"type": "string", "format": "binary"}} for kind in media_types}}}
