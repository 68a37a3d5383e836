"""Learning from demonstrations: training policies and evaluating them."""
