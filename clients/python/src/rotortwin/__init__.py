"""Client of the rotortwin server: submit flights, watch them, fetch results.

    from rotortwin import Client

    with Client("http://127.0.0.1:8400") as client:
        run = client.runs.submit("short-hover", seed=7)
        run = client.runs.wait(run.id, progress=True, check=True)
        frame = client.runs.telemetry_frame(run.id)
"""

from ._aio_resource import AsyncResource
from ._resource import Resource
from .aio import AsyncBlindBenches, AsyncCampaigns, AsyncClient, AsyncJobs, AsyncLibrary, AsyncModels, AsyncRuns, AsyncScenarios
from .aio_fdi import AsyncFdi, AsyncFdiSession
from .aio_twin import AsyncClassifiers, AsyncComparisons, AsyncDiagnoses, AsyncImprovements, AsyncLogs
from .client import BlindBenches, Campaigns, Client, Jobs, Library, Models, Runs, Scenarios
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
from .fdi import Fdi, FdiSession
from .models import (
    Artifact,
    Channel,
    Complaint,
    Event,
    FdiAnswer,
    FdiState,
    FdiWindow,
    Job,
    Run,
    Sample,
    Ticket,
    Validation,
    Verification,
)
from .twin import Classifiers, Comparisons, Diagnoses, Improvements, Logs

__all__ = [
    "Artifact",
    "AsyncBlindBenches",
    "AsyncCampaigns",
    "AsyncClassifiers",
    "AsyncClient",
    "AsyncComparisons",
    "AsyncDiagnoses",
    "AsyncFdi",
    "AsyncFdiSession",
    "AsyncImprovements",
    "AsyncJobs",
    "AsyncLibrary",
    "AsyncLogs",
    "AsyncModels",
    "AsyncResource",
    "AsyncRuns",
    "AsyncScenarios",
    "BadRequest",
    "BlindBenches",
    "Campaigns",
    "Channel",
    "Complaint",
    "Classifiers",
    "Client",
    "Comparisons",
    "Conflict",
    "ConnectionLost",
    "Diagnoses",
    "DiskFull",
    "Event",
    "Fdi",
    "FdiAnswer",
    "FdiSession",
    "FdiState",
    "FdiWindow",
    "Improvements",
    "Job",
    "JobFailed",
    "Jobs",
    "Library",
    "Logs",
    "Models",
    "NotFound",
    "Problem",
    "Resource",
    "RotortwinError",
    "Run",
    "Runs",
    "Sample",
    "Scenarios",
    "Ticket",
    "Unauthorized",
    "Unavailable",
    "UnexpectedAnswer",
    "Unprocessable",
    "Validation",
    "Verification",
]
