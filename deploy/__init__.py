"""How the services are brought up: the command line, the supervisor, the live table."""
