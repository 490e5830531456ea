"""Stamps (F11) and the text of strangers (F16)."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msg_adapters.cdr import Stamp
from msg_adapters.stamp import decode_stamp
from msg_adapters.text import clean_text


def test_a_stamp_is_its_nanoseconds() -> None:
    assert decode_stamp(Stamp(1_700_000_000, 123_456_789)) == 1_700_000_000_123_456_789
    assert decode_stamp(Stamp(0, 1)) == 1


@pytest.mark.parametrize("stamp", (Stamp(0, 0), Stamp(-1, 5), Stamp(5, 1_000_000_000), Stamp(5, 2**32 - 1)))
def test_f11_zero_negative_and_overflowing_stamps_are_refused(stamp: Stamp) -> None:
    with pytest.raises(ValueError, match="stamp"):
        decode_stamp(stamp)


@given(st.one_of(st.text(), st.text(min_size=200), st.none(), st.binary()))
def test_whatever_the_text_forty_clean_characters_are_left(text: object) -> None:
    shown = clean_text(text)
    assert shown.isascii()
    assert shown.isprintable()
    assert len(shown) <= 42


def test_clean_text_is_left_as_it_is() -> None:
    assert clean_text("yuv422_yuy2") == "'yuv422_yuy2'"
    assert clean_text("a" * 41) == "'" + "a" * 37 + "...'"
