"""The smallest model that fails as a stored run does: `contactlab shrink STORE RUN`."""
