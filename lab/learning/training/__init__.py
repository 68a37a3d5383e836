"""Training of policies on a data set of demonstrations."""
