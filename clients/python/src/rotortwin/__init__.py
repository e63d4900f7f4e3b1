"""Client of the rotortwin server: submit flights, watch them, fetch results.

    from rotortwin import Client

    with Client("http://127.0.0.1:8400") as client:
        run = client.runs.submit("short-hover", seed=7)
        run = client.runs.wait(run.id, progress=True, check=True)
        frame = client.runs.telemetry_frame(run.id)
"""

from .aio import AsyncCampaigns, AsyncClient, AsyncJobs, AsyncLibrary, AsyncResource, AsyncRuns, AsyncScenarios
from .client import Campaigns, Client, Jobs, Library, Resource, Runs, Scenarios
from .errors import (
    BadRequest,
    Conflict,
    ConnectionLost,
    DiskFull,
    JobFailed,
    NotFound,
    Problem,
    RotortwinError,
    Unauthorized,
    Unavailable,
    UnexpectedAnswer,
    Unprocessable,
)
from .models import Artifact, Channel, Event, Job, Run, Ticket, Validation, Verification

__all__ = [
    "Artifact",
    "AsyncCampaigns",
    "AsyncClient",
    "AsyncJobs",
    "AsyncLibrary",
    "AsyncResource",
    "AsyncRuns",
    "AsyncScenarios",
    "BadRequest",
    "Campaigns",
    "Channel",
    "Client",
    "Conflict",
    "ConnectionLost",
    "DiskFull",
    "Event",
    "Job",
    "JobFailed",
    "Jobs",
    "Library",
    "NotFound",
    "Problem",
    "Resource",
    "RotortwinError",
    "Run",
    "Runs",
    "Scenarios",
    "Ticket",
    "Unauthorized",
    "Unavailable",
    "UnexpectedAnswer",
    "Unprocessable",
    "Validation",
    "Verification",
]
