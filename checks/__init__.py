"""What shows that the C is the mathematics: comparisons with the model, guarantees of the C, measurements."""
