-- What a run's sequential detector said at the end: lists are filtered by it without reading results. NULL: no run, not done, or it was
-- never said.
ALTER TABLE job ADD COLUMN verdict BIGINT;
UPDATE job SET verdict = json_extract(result, '$.intervals[#-1].scores.sequential.verdict_at_end')
    WHERE kind = 'run' AND json_valid(result);
CREATE INDEX job_verdict ON job (kind, verdict, id, tenant) WHERE verdict IS NOT NULL;
