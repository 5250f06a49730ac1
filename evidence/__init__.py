"""The paper's figures and further ones, drawn from runs, each with its claims checked by number."""
