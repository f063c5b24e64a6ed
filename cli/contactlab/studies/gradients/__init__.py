"""Where derivatives of a simulation through contact can be trusted."""
