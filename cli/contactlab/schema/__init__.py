"""Models of exchanged files: sweeps, scenes, records. Each report has a module of its own."""
