"""The kinds of operator in a trial, and the services that each consists of."""
