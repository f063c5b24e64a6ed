"""Models of exchanged files: sweeps, scenes, records, reports."""
