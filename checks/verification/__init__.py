"""Comparison of the C with the model: given cases, random states, golden vectors;
`generate` compares before it returns C."""
