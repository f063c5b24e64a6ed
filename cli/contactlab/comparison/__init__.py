"""Two stores to verdicts, without the engine."""
