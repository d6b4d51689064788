"""Memory of arrays that are made and dropped again and again."""

from __future__ import annotations

from functools import cache

import numpy as np

KEPT = 31 << 20
"""Size of a block [bytes], below the 32 MiB up to which glibc's allocator adapts itself to blocks that are freed."""


@cache
def keep_freed_memory() -> None:
    """Let the allocator keep the memory of arrays that are dropped, for those to come.

    glibc maps large blocks from the system and gives them back, and the system clears every page anew: a tenth of the
    time of cases that are solved together. Once a block has been freed, blocks up to its size come from memory that is
    kept, up to twice its size (mallopt(3), ``M_MMAP_THRESHOLD``). Nothing is touched of the block that is taken here.
    Other allocators are left as they are.
    """
    np.empty(KEPT, np.uint8)
