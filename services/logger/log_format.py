"""What a log holds beside messages: its profile, metadata records and compression.

The names of metadata records stand in the files; changing one makes earlier logs unreadable.
"""

import errno
import shutil
from pathlib import Path

from mcap.writer import CompressionType

from services.logger.errors import LoggerError

PROFILE = "trill"
START_METADATA = "recording"
"""How the recording was made; the first record of each segment."""
CARRIED_METADATA = "carried"
"""In a segment that continues another: delivery statistics so far, and the open episode."""
DROPS_METADATA = "drops"
"""What the logger dropped since the last such record."""
DELIVERY_METADATA = "account"
"""At the end: the delivery statistics of the recording up to here, with all sequence numbers."""
END_METADATA = "end"
"""At the end of the recording, not of a segment: when it was stopped."""
REPAIR_METADATA = "repair"
"""Written by the repair: what was wrong and what could not be read."""

COMPRESSION = {
    "zstd": CompressionType.ZSTD,
    "lz4": CompressionType.LZ4,
    "none": CompressionType.NONE,
}


def write_error(path: Path, error: OSError) -> LoggerError:
    """Return a LoggerError for ``error`` in writing ``path``, with a remedy."""
    if isinstance(error, FileExistsError) and error.filename == str(path):
        return LoggerError(f"{path} exists already; give a new --out directory")
    remedy = "give a writable --out directory"
    if error.errno in {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}:
        remedy = f"free some space ({_free_space(path)}); what was flushed before stays readable"
    return LoggerError(f"cannot write the log {path}: {error.strerror or error}; {remedy}")


def _free_space(path: Path) -> str:
    free = shutil.disk_usage(path.parent).free
    return f"{free / 2**20:.0f} MiB free in {path.parent}"
