"""After a run: summary, scores, pictures and video, all from its log."""
