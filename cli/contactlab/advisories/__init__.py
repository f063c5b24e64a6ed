"""Known faults of engines: their files, and the models that meet them."""
