"""Settings that explain recorded motion: `contactlab fit`, and `contactlab.fit`."""
