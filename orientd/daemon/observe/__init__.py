"""What happened: the journal, the flight recorder, the log."""
