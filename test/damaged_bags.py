"""Bags that are damaged in the middle, as failing discs and flipped bits do it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

PAGE = 4096


def damage_middle(bag: Path) -> None:
    """Overwrite the head of the middle chunk of an MCAP file, or a page of a message in the middle of a database."""
    (file,) = (p for p in bag.iterdir() if p.suffix in (".mcap", ".db3"))
    content = bytearray(file.read_bytes())
    start = _middle_chunk(file) if file.suffix == ".mcap" else _middle_overflow_page(content)
    content[start : start + PAGE] = np.random.default_rng(5).integers(0, 256, PAGE).astype(np.uint8).tobytes()
    file.write_bytes(content)


def _middle_chunk(file: Path) -> int:
    from rosbags.rosbag2.storage_mcap import McapReader

    reader = McapReader(file)
    reader.open()
    chunks = sorted(chunk.chunk_start_offset for chunk in reader.chunks)
    reader.close()
    assert len(chunks) >= 3, "too small a bag to have a middle"
    return chunks[len(chunks) // 2]


def _middle_overflow_page(content: bytearray) -> int:
    """First page from the middle on that holds part of a long message: it starts with the number of the next page."""
    page = len(content) // 2 // PAGE
    while int.from_bytes(content[PAGE * page : PAGE * page + 4], "big") != page + 2:
        page += 1
    return PAGE * page
