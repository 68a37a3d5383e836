"""Episode marks, latency breakdown, replay and playback of logs."""
