"""The commands of ``trill``, one module each: options in, exit code out."""
