"""From a planned sweep to a store: jobs, workers, records, replays."""
