"""What each step of a service took in, and where the time of a message went."""
