"""Review a finished run from its log: summary, scores, plots, contact sheet and video."""
