"""What the system does when something around it fails."""
