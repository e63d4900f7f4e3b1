-- All that a claim and an account look at: without them each reads every job's row, with its long texts.
DROP INDEX job_queue;
CREATE INDEX job_queue ON job (status, tenant, priority, id, waits_for, not_before_ms);
CREATE INDEX job_account ON job (tenant, status, bytes);
