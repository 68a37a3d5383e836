"""A set of sequence numbers with a bit for each, for the millions of a recording of hours."""

_BITS = 1024


class Numbers:
    """A set of integers that lie close together."""

    def __init__(self) -> None:
        """Start empty."""
        self._words: dict[int, int] = {}
        self._count = 0

    def __len__(self) -> int:
        return self._count

    def __contains__(self, number: int) -> bool:
        place, bit = divmod(number, _BITS)
        return bool(self._words.get(place, 0) >> bit & 1)

    def add(self, number: int) -> None:
        """Add ``number``."""
        place, bit = divmod(number, _BITS)
        word = self._words.get(place, 0)
        more = word | 1 << bit
        if more != word:
            self._words[place] = more
            self._count += 1
