"""Arrays for the page are found again by their references, in the byte order that browsers have."""

import base64
import gzip

import numpy as np

from pinarm.use.show.replay.packing import Packing, compressed


def test_arrays_are_read_back_where_their_references_point() -> None:
    arrays = [
        np.arange(3, dtype=np.uint16), np.array([[0.1, -2.5], [1e300, 0.0]]), np.array([7.25], dtype=np.float32),
        np.arange(5, dtype=np.uint32), np.empty(0),
    ]  # fmt: skip
    packing = Packing()
    references = [packing.add(array) for array in arrays]
    raw = gzip.decompress(base64.b64decode(packing.text()))
    for array, (code, first, count) in zip(arrays, references, strict=True):
        assert int(first) % 8 == 0
        read = np.frombuffer(raw, dtype=f"<{code}", count=int(count), offset=int(first))
        assert read.tolist() == array.ravel().tolist()


def test_the_same_bytes_give_the_same_text() -> None:
    """The header of gzip has no time of writing: bytes 4 to 7, RFC 1952, section 2.3.1."""
    assert compressed(b"abc" * 100) == compressed(b"abc" * 100)
    assert base64.b64decode(compressed(b"abc"))[4:8] == bytes(4)
    assert len(compressed(bytes(10_000))) < 100
