"""What all resources of a client share: its settings and its connections."""

from __future__ import annotations

from dataclasses import dataclass

import httpx

from ._exchange import Settings


@dataclass
class Transport:
    """With threads."""

    settings: Settings
    http: httpx.Client


@dataclass
class AsyncTransport:
    """With asyncio."""

    settings: Settings
    http: httpx.AsyncClient
