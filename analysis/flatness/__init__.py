"""Flatness of q' = S(q) nu: verdicts with their theorems, flat outputs,
chained forms and where they are singular."""
