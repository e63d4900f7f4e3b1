-- What a run's sequential detector said at the end: lists are filtered by it without reading results. NULL: no run, not done, or it was
-- never said.
ALTER TABLE job ADD COLUMN verdict BIGINT;
UPDATE job SET verdict = CAST(CAST(result AS json) -> 'intervals' -> -1 -> 'scores' -> 'sequential' ->> 'verdict_at_end' AS BIGINT)
    WHERE kind = 'run' AND result IS NOT NULL;
CREATE INDEX job_verdict ON job (kind, verdict, id, tenant) WHERE verdict IS NOT NULL;
