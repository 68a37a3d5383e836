"""The paper's policy: recurrent, with locomotion apart from manipulation."""
