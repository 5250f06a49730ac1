"""What a robot can do: growth, integrals, control properties, singularities, zero dynamics,
certified starts."""
