"""Logs: the list with results, and the download by opaque id."""

from dataclasses import asdict
from typing import Any

from fastapi import APIRouter
from fastapi.exceptions import HTTPException
from fastapi.responses import FileResponse

from console.log_rows import log_path, log_rows
from console.parts import NeedsParts

router = APIRouter(prefix="/api/logs")


@router.get("")
def logs(parts: NeedsParts) -> list[dict[str, Any]]:
    """Return all logs, the newest first."""
    status = parts.watch.view.status
    job = None if status is None else status.job
    being_written = job.log if job is not None and job.active else None
    return [asdict(row) for row in log_rows(parts.catalogue, being_written)]


@router.get("/{log_id}/download")
def download(log_id: str, parts: NeedsParts) -> FileResponse:
    """Send the file of a log."""
    path = log_path(parts.catalogue, log_id)
    if path is None or not path.is_file():
        raise HTTPException(404, "there is no such log; reload the list")
    return FileResponse(path, media_type="application/octet-stream", filename=path.name)
