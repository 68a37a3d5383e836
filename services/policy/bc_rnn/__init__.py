"""The paper's recurrent baseline: one flat mixture of everything a set-point has."""
