"""From models to evidence: builds and loads the C, checks it against the symbolic reference, simulates, draws."""
