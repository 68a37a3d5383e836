"""The format of demonstrations: columns, episode files, observation and action vectors."""
