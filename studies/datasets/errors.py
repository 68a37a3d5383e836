"""What goes wrong when a data set is exported."""

from common.errors import TrillError


class DatasetError(TrillError):
    """A data set cannot be exported or checked."""
