"""Hand targets that operators move, and the set-points made of them."""
