"""Studies: run the services in simulated time, measure, and print what was found."""
