"""A bounded run of tests/fuzz/readers.py, which goes on for as long as one likes."""

from __future__ import annotations

import warnings

import pytest

from tests.fuzz.readers import READERS, fuzz


@pytest.mark.parametrize("name", READERS)
def test_no_reader_comes_to_grief(name: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of what makes the files; readers are held to none
        tally = fuzz(name, cases=150, seed=1_000_000)
    assert not tally.faults, "\n".join(tally.faults[:3])
    assert tally.read > 0
    assert tally.refused > 0
