-- Events get a place in one order over all jobs, so that one stream can tell them all and go on where it was broken off; and browsers get
-- sessions, which are worth what their tokens are worth.
CREATE TABLE job_event_in_order (
    position INTEGER PRIMARY KEY AUTOINCREMENT, -- never given twice, whatever is deleted
    written BIGINT NOT NULL DEFAULT 0,   -- Postgres: number of the transaction; here they follow one another
    job_id TEXT NOT NULL REFERENCES job (id) ON DELETE CASCADE,
    seq BIGINT NOT NULL,                 -- from 1, without gaps
    at_ms BIGINT NOT NULL,
    kind TEXT NOT NULL,
    data TEXT NOT NULL,                  -- JSON
    UNIQUE (job_id, seq)
);
INSERT INTO job_event_in_order (job_id, seq, at_ms, kind, data)
SELECT job_id, seq, at_ms, kind, data FROM job_event ORDER BY at_ms, job_id, seq;
DROP TABLE job_event;
ALTER TABLE job_event_in_order RENAME TO job_event;
CREATE INDEX job_event_order ON job_event (written, position);

CREATE TABLE session (
    hash TEXT PRIMARY KEY,               -- SHA-256 of the secret in the cookie; the secret is nowhere
    token_id TEXT NOT NULL,
    expires_ms BIGINT NOT NULL
);
