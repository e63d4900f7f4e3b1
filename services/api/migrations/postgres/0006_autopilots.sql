-- Autopilots that operators have listed, each with the one process that can reach it; a run may name one.
CREATE TABLE autopilot (
    name TEXT PRIMARY KEY,
    protocol TEXT NOT NULL,              -- ardupilot, px4, betaflight
    lockstep BIGINT NOT NULL,            -- 1: it waits for the plant in each of its steps
    worker TEXT NOT NULL,                -- the process on whose host it was listed, and which alone flies with it
    until_ms BIGINT NOT NULL,            -- that process has said so for the time until then
    version TEXT,                        -- what it called itself in its last flight
    flown_ms BIGINT                      -- end of that flight
);
ALTER TABLE job ADD COLUMN autopilot TEXT; -- name of the one that flies this run; one run at a time has it
