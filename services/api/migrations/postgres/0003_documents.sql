-- Documents that clients leave in the library, each on its account.
CREATE TABLE document (
    tenant TEXT NOT NULL,
    folder TEXT NOT NULL,                -- of the library: scenarios, vehicles, …
    name TEXT NOT NULL,
    text TEXT NOT NULL,
    hash TEXT NOT NULL,                  -- of the text
    changed_ms BIGINT NOT NULL,
    PRIMARY KEY (tenant, folder, name)
);
