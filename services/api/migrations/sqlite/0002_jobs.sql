-- Runs become one kind of job. Text and 64-bit integers only, as in ../postgres: one set of statements serves both.
CREATE TABLE job (
    id TEXT PRIMARY KEY,                 -- time-ordered: 12 hex digits of ms, 20 random ones
    kind TEXT NOT NULL,                  -- run, campaign, campaign-shard, …
    name TEXT NOT NULL,                  -- of the scenario, of the campaign, …
    tenant TEXT NOT NULL,                -- on whose account
    status TEXT NOT NULL,                -- queued, running, done, failed, canceled
    priority BIGINT NOT NULL,            -- larger goes first among the jobs of a tenant
    spec TEXT NOT NULL,                  -- JSON: everything that a worker needs, whatever becomes of the files
    facts TEXT NOT NULL,                 -- JSON: what lists show: vehicle, seed, link, …
    parent TEXT,                         -- the job that this one was forked from
    part_of TEXT,                        -- the job that waits for this one
    waits_for BIGINT NOT NULL DEFAULT 0, -- parts that are not done
    idempotency_key TEXT,
    request_hash TEXT NOT NULL,          -- of what was submitted: another body under the same key is refused
    submitted_ms BIGINT NOT NULL,
    started_ms BIGINT,
    finished_ms BIGINT,
    not_before_ms BIGINT NOT NULL DEFAULT 0, -- a retry waits
    attempts BIGINT NOT NULL DEFAULT 0,  -- how often it was begun
    failures BIGINT NOT NULL DEFAULT 0,  -- how often an attempt failed by itself; a worker that dies counts not
    wall_limit_ms BIGINT NOT NULL,
    claim TEXT,                          -- token of the attempt that runs; a worker without it may write nothing
    claim_until_ms BIGINT,
    worker TEXT,                         -- who has or had it
    cancel_requested BIGINT NOT NULL DEFAULT 0,
    ticket TEXT,                         -- JSON: how peers from outside join the attempt that runs
    folder TEXT,                         -- of the attempt that counts, in the artifact store
    bytes BIGINT NOT NULL DEFAULT 0,     -- of its files
    run_hash TEXT,
    error TEXT,
    result TEXT,                         -- JSON
    metrics TEXT                         -- JSON: the numbers of the result, flat
);
INSERT INTO job (id, kind, name, tenant, status, priority, spec, facts, parent, idempotency_key, request_hash, submitted_ms, started_ms,
    finished_ms, attempts, wall_limit_ms, claim, claim_until_ms, cancel_requested, folder, run_hash, error, result)
SELECT id, 'run', name, 'local', status, priority,
    json_object('documents', documents, 'seed', seed, 'link', link, 'pace', pace),
    json_object('vehicle', vehicle, 'seed', seed, 'link', link, 'pace', pace),
    parent, idempotency_key, request_hash, submitted_ms, started_ms, finished_ms, attempts, 21600000, claim, claim_until_ms,
    cancel_requested, folder, run_hash, error, summary
FROM run;
CREATE UNIQUE INDEX job_key ON job (tenant, kind, idempotency_key);
CREATE INDEX job_queue ON job (status, tenant, priority, id);
CREATE INDEX job_kind ON job (kind, id);
CREATE INDEX job_part ON job (part_of);

CREATE TABLE job_event (
    job_id TEXT NOT NULL REFERENCES job (id) ON DELETE CASCADE,
    seq BIGINT NOT NULL,                 -- from 1, without gaps
    at_ms BIGINT NOT NULL,
    kind TEXT NOT NULL,
    data TEXT NOT NULL,                  -- JSON
    PRIMARY KEY (job_id, seq)
);
INSERT INTO job_event SELECT run_id, seq, at_ms, kind, data FROM event;
DROP TABLE event;
DROP TABLE run;

-- Places of a run that another host takes: its controller, its FDI engine.
CREATE TABLE seat (
    job_id TEXT NOT NULL REFERENCES job (id) ON DELETE CASCADE,
    role TEXT NOT NULL,                  -- controller, fdi
    attempt_claim TEXT NOT NULL,         -- the job's claim: a seat of an attempt that is gone is worth nothing
    ticket TEXT NOT NULL,                -- JSON
    claim TEXT,                          -- token of who sits there
    PRIMARY KEY (job_id, role)
);

CREATE TABLE token (
    id TEXT PRIMARY KEY,
    name TEXT NOT NULL,
    tenant TEXT NOT NULL,
    hash TEXT NOT NULL UNIQUE,           -- SHA-256 of the secret; the secret is nowhere
    scopes TEXT NOT NULL,                -- words, separated by blanks
    created_ms BIGINT NOT NULL,
    expires_ms BIGINT,
    revoked_ms BIGINT
);
