"""How the services are brought up, watched and looked back on; the command line is in cli/."""
