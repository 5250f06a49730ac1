"""The derivation that ships: the law in short steps, in the frame where it is cheapest."""
