-- Which jobs read the files of which: while one of the former waits or runs, the latter cannot be deleted. What a part reads stands here for
-- the whole.
CREATE TABLE job_need (
    job_id TEXT NOT NULL REFERENCES job (id) ON DELETE CASCADE,
    needs TEXT NOT NULL,                 -- id of the job whose files it reads
    PRIMARY KEY (job_id, needs)
);
CREATE INDEX job_needed ON job_need (needs);
INSERT INTO job_need (job_id, needs)
    SELECT DISTINCT COALESCE(j.part_of, j.id), substr(f.key, 6, 32) FROM job j
    CROSS JOIN LATERAL json_array_elements(
        CASE WHEN json_typeof(CAST(j.spec AS json) -> 'inputs') = 'array' THEN CAST(j.spec AS json) -> 'inputs' ELSE CAST('[]' AS json) END
    ) AS i (value)
    CROSS JOIN LATERAL (SELECT COALESCE(i.value #>> '{content,file}', i.value #>> '{content,folder}') AS key) AS f
    WHERE j.status IN ('queued', 'running') AND (f.key LIKE 'jobs/%' OR f.key LIKE 'runs/%');

-- The file that came with a job stays until the job is deleted, and counts from the moment at which the job was accepted.
ALTER TABLE job ADD COLUMN upload_bytes BIGINT NOT NULL DEFAULT 0;
UPDATE job SET upload_bytes = COALESCE(CAST(CAST(facts AS json) ->> 'bytes' AS BIGINT), 0)
    WHERE kind = 'log' AND CAST(facts AS json) ->> 'upload' IS NOT NULL;
UPDATE job SET bytes = bytes + upload_bytes WHERE upload_bytes > 0;
