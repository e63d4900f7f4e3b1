-- Runs and their events. Text and 64-bit integers only, so that one SQL serves SQLite and Postgres. Times: ms since 1970, UTC.
CREATE TABLE run (
    id TEXT PRIMARY KEY,                 -- time-ordered: 12 hex digits of ms, 20 random ones
    name TEXT NOT NULL,                  -- of the scenario
    vehicle TEXT NOT NULL,
    status TEXT NOT NULL,                -- queued, running, done, failed, canceled
    priority BIGINT NOT NULL,            -- larger goes first
    documents TEXT NOT NULL,             -- scenario, vehicle, blades, classifier in full (TOML): what is flown, whatever becomes of the files
    seed TEXT NOT NULL,                  -- u64
    link TEXT NOT NULL,
    pace TEXT NOT NULL,
    parent TEXT,                         -- the run that this one was forked from
    idempotency_key TEXT UNIQUE,
    request_hash TEXT NOT NULL,          -- of what was submitted: another body under the same key is refused
    submitted_ms BIGINT NOT NULL,
    started_ms BIGINT,
    finished_ms BIGINT,
    attempts BIGINT NOT NULL DEFAULT 0,
    claim TEXT,                          -- token of the worker that flies it; a worker without it may write nothing
    claim_until_ms BIGINT,
    cancel_requested BIGINT NOT NULL DEFAULT 0,
    folder TEXT,                         -- of the attempt that counts, relative to the data folder
    run_hash TEXT,
    error TEXT,
    summary TEXT                         -- JSON
);
CREATE INDEX run_queue ON run (status, priority, id);

CREATE TABLE event (
    run_id TEXT NOT NULL REFERENCES run (id) ON DELETE CASCADE,
    seq BIGINT NOT NULL,                 -- from 1, without gaps
    at_ms BIGINT NOT NULL,
    kind TEXT NOT NULL,
    data TEXT NOT NULL,                  -- JSON
    PRIMARY KEY (run_id, seq)
);
