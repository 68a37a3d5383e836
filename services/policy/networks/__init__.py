"""Networks of the policies and their losses; they need torch."""
