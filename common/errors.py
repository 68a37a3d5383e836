"""Root of every exception this project raises."""


class TrillError(Exception):
    """Root exception; messages say what happened, what was expected, what was got, how to mend."""


class SchemaError(TrillError):
    """A message does not fit its schema (wrong field, shape, dtype, range or non-finite value)."""


class ConfigError(TrillError):
    """A configuration file or option is wrong."""
