"""How far a list is: a bar by tqdm where that is installed, else one line on stderr."""
from __future__ import annotations

import sys
from typing import Iterable, Iterator, TypeVar

T = TypeVar("T")


def shown(items: Iterable[T], total: int, show: bool = True) -> Iterator[T]:
    """ITEMS as they are, TOTAL of them, and how many have been; nothing is written unless SHOW."""
    if not show:
        yield from items
        return
    try:
        from tqdm.auto import tqdm
    except ImportError:
        for number, item in enumerate(items, 1):
            sys.stderr.write(f"\rmodald: {number} of {total}" + "\n" * (number == total))
            sys.stderr.flush()
            yield item
    else:
        yield from tqdm(items, total=total)
