"""The paper's reactive baseline: behavioural cloning of the current frame."""
