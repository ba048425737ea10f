# SPDX-License-Identifier: BSD-3-Clause
"""Notes of many estimators are merged."""

from coclo_vio.evaluation.notes import merged_notes


def test_notes_that_differ_in_numbers_become_one_with_a_range() -> None:
    notes = {"a": ["The offset, -0.05 s, over 1 m."], "b": ["The offset, -0.0368 s, over 1 m."]}
    assert merged_notes(notes) == ["The offset, -0.05 to -0.0368 s, over 1 m."]


def test_a_note_of_some_is_preceded_by_their_names() -> None:
    notes = {"a": ["Same.", "It is # 3."], "b": ["Same."], "c": ["Same.", "It is # 3."]}
    assert merged_notes(notes) == ["Same.", "a, c: It is # 3."]
