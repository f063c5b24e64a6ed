"""What a model's simulation is worth under its task: `contactlab examine MODEL`."""
