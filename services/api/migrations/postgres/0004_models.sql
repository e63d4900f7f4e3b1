-- Models that grow: numbered versions that never change, and branches that stand at one of them, each model on its account.
-- The head of `main` stands in `document` as well, under the model's name.
CREATE TABLE model (
    tenant TEXT NOT NULL,
    name TEXT NOT NULL,
    versions BIGINT NOT NULL,            -- how many were made: the next one's number
    PRIMARY KEY (tenant, name)
);

CREATE TABLE model_version (
    tenant TEXT NOT NULL,
    model TEXT NOT NULL,
    number BIGINT NOT NULL,              -- from 0, over all branches
    text TEXT NOT NULL,                  -- TOML that says everything
    made_ms BIGINT NOT NULL,
    PRIMARY KEY (tenant, model, number)
);

CREATE TABLE model_branch (
    tenant TEXT NOT NULL,
    model TEXT NOT NULL,
    branch TEXT NOT NULL,
    number BIGINT NOT NULL,              -- the version that it stands at
    PRIMARY KEY (tenant, model, branch)
);
