"""The operator's page in a real browser, with a robot, and a headset that is emulated."""
