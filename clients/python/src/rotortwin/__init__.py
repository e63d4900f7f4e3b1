"""rotortwin from Python: flights and the twin in this process, and the client of a server.

    import rotortwin

    flight = rotortwin.Simulation("hover", seed=1).run()    # here: rotortwin.simulation, rotortwin.gym
    found = rotortwin.diagnose("flight.ulg", "my-vehicle.toml")    # here: rotortwin.analysis
    from rotortwin import detectors                         # your own next to ours, on the same flights

    from rotortwin import Client

    with Client("http://127.0.0.1:8400") as client:
        run = client.runs.submit("short-hover", seed=7)
        run = client.runs.wait(run.id, progress=True, check=True)
        frame = client.runs.telemetry_frame(run.id)
"""

import importlib
from typing import TYPE_CHECKING, Any

from ._aio_resource import AsyncResource
from ._resource import Resource
from .aio import (
    AsyncBlindBenches,
    AsyncCampaigns,
    AsyncClient,
    AsyncEffects,
    AsyncJobs,
    AsyncLibrary,
    AsyncModels,
    AsyncRuns,
    AsyncScenarios,
    AsyncVehicles,
)
from .aio_fdi import AsyncFdi, AsyncFdiSession
from .aio_twin import (
    AsyncClassifiers,
    AsyncComparisons,
    AsyncDiagnoses,
    AsyncIdentifications,
    AsyncImprovements,
    AsyncLogs,
    AsyncNextFlights,
)
from .client import BlindBenches, Campaigns, Client, Effects, Jobs, Library, Models, Runs, Scenarios, Vehicles
from .errors import (
    BadRequest,
    CampaignFailed,
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
    Autopilot,
    BlindCase,
    BucketNoise,
    Buckets,
    CampaignFlight,
    Channel,
    ChannelSeries,
    Complaint,
    ConditionSeries,
    Effectiveness,
    Event,
    FdiAnswer,
    FdiEvent,
    FdiState,
    FdiWindow,
    FlightCondition,
    HiddenEffect,
    HiddenTruth,
    Hover,
    Identity,
    Job,
    LibraryCampaign,
    Limits,
    ManoeuvreEvidence,
    ModelSeries,
    PlacedEvent,
    ProposedManoeuvre,
    QueryAnswer,
    QueryColumn,
    RotorGeometry,
    Run,
    RunTable,
    Sample,
    Ticket,
    Validation,
    VehicleGeometry,
    Verification,
)
from .twin import Classifiers, Comparisons, Diagnoses, Identifications, Improvements, Logs, NextFlights

if TYPE_CHECKING:
    from .analysis import IdentifiedVehicle, Improved, JudgedLog, Result, compare, diagnose, fdi_log, improve, vehicle_from_log
    from ._campaign import campaign
    from ._query import query
    from .simulation import FlightError, Flights, InputError, Scenario, Simulation, SimulationBatch, Verdict, fly

#: Modules that run in this process: imported on demand, as the client of a server needs neither NumPy nor the native module.
_HERE = {
    "analysis": (
        "IdentifiedVehicle", "Improved", "JudgedLog", "Result", "compare", "diagnose", "fdi_log", "improve", "vehicle_from_log",
    ),  # fmt: skip
    "_campaign": ("campaign",),
    "_query": ("query",),
    "simulation": ("FlightError", "Flights", "InputError", "Scenario", "Simulation", "SimulationBatch", "Verdict", "fly"),
}


def __getattr__(name: str) -> Any:
    for module, names in _HERE.items():
        if name in names:
            return getattr(importlib.import_module(f"{__name__}.{module}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


__all__ = [
    "Artifact",
    "AsyncBlindBenches",
    "AsyncCampaigns",
    "AsyncClassifiers",
    "AsyncClient",
    "AsyncComparisons",
    "AsyncDiagnoses",
    "AsyncEffects",
    "AsyncFdi",
    "AsyncFdiSession",
    "AsyncIdentifications",
    "AsyncImprovements",
    "AsyncJobs",
    "AsyncLibrary",
    "AsyncLogs",
    "AsyncModels",
    "AsyncNextFlights",
    "AsyncResource",
    "AsyncRuns",
    "AsyncScenarios",
    "AsyncVehicles",
    "Autopilot",
    "BadRequest",
    "BlindBenches",
    "BlindCase",
    "BucketNoise",
    "Buckets",
    "CampaignFailed",
    "CampaignFlight",
    "Campaigns",
    "Channel",
    "ChannelSeries",
    "Classifiers",
    "Client",
    "Comparisons",
    "Complaint",
    "ConditionSeries",
    "Conflict",
    "ConnectionLost",
    "Diagnoses",
    "DiskFull",
    "Effectiveness",
    "Effects",
    "Event",
    "Fdi",
    "FdiAnswer",
    "FdiEvent",
    "FdiSession",
    "FdiState",
    "FdiWindow",
    "FlightCondition",
    "FlightError",
    "Flights",
    "HiddenEffect",
    "HiddenTruth",
    "Hover",
    "Identifications",
    "IdentifiedVehicle",
    "Identity",
    "Improved",
    "Improvements",
    "InputError",
    "Job",
    "JobFailed",
    "Jobs",
    "JudgedLog",
    "Library",
    "LibraryCampaign",
    "Limits",
    "Logs",
    "ManoeuvreEvidence",
    "ModelSeries",
    "Models",
    "NextFlights",
    "NotFound",
    "PlacedEvent",
    "Problem",
    "ProposedManoeuvre",
    "QueryAnswer",
    "QueryColumn",
    "Resource",
    "Result",
    "RotorGeometry",
    "RotortwinError",
    "Run",
    "RunTable",
    "Runs",
    "Sample",
    "Scenario",
    "Scenarios",
    "Simulation",
    "SimulationBatch",
    "Ticket",
    "Unauthorized",
    "Unavailable",
    "UnexpectedAnswer",
    "Unprocessable",
    "Validation",
    "VehicleGeometry",
    "Vehicles",
    "Verdict",
    "Verification",
    "campaign",
    "compare",
    "diagnose",
    "fdi_log",
    "fly",
    "improve",
    "query",
    "vehicle_from_log",
]
