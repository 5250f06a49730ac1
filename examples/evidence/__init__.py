"""The paper's figures and further ones, drawn from simulated runs;
the claims of each are checked numerically."""
