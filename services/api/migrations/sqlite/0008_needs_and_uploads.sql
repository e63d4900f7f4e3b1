-- Which jobs read the files of which: while one of the former waits or runs, the latter cannot be deleted. What a part reads stands here for
-- the whole.
CREATE TABLE job_need (
    job_id TEXT NOT NULL REFERENCES job (id) ON DELETE CASCADE,
    needs TEXT NOT NULL,                 -- id of the job whose files it reads
    PRIMARY KEY (job_id, needs)
);
CREATE INDEX job_needed ON job_need (needs);
INSERT INTO job_need (job_id, needs)
    SELECT DISTINCT id, substr(key, 6, 32) FROM (
        SELECT COALESCE(j.part_of, j.id) AS id,
            CASE WHEN i.type = 'object' THEN
                COALESCE(json_extract(i.value, '$.content.file'), json_extract(i.value, '$.content.folder')) END AS key
        FROM job j, json_each(CASE WHEN json_valid(j.spec) THEN j.spec ELSE '{}' END, '$.inputs') i
        WHERE j.status IN ('queued', 'running')
    ) WHERE key LIKE 'jobs/%' OR key LIKE 'runs/%';

-- The file that came with a job stays until the job is deleted, and counts from the moment at which the job was accepted.
ALTER TABLE job ADD COLUMN upload_bytes BIGINT NOT NULL DEFAULT 0;
UPDATE job SET upload_bytes = CAST(COALESCE(json_extract(facts, '$.bytes'), 0) AS INTEGER)
    WHERE kind = 'log' AND json_extract(facts, '$.upload') IS NOT NULL;
UPDATE job SET bytes = bytes + upload_bytes WHERE upload_bytes > 0;
