"""Jobs, workers, records and replays: from a planned sweep to a store."""
