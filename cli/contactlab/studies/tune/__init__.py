"""From a model to the settings to use: `contactlab tune`, and `contactlab.tune`."""
