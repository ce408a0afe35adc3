from readygo.apps.report.markdown import markdown_lines
from readygo.apps.report.page import Estimate, PageTable, Subheading, small_print


def test_table_has_its_columns_aligned_and_intervals_in_brackets() -> None:
    table = PageTable(("Arm", "SR"), [["a", Estimate("5", "4 to 6")], ["b", Estimate("7")], ["c", ""]])
    assert markdown_lines(table) == ["| Arm | SR |", "| --- | ---: |", "| a | 5 (4 to 6) |", "| b | 7 |", "| c |  |"]


def test_headings_and_paragraphs_are_lines() -> None:
    assert markdown_lines(Subheading("Cell")) == ["### Cell"]
    assert markdown_lines(small_print("words")) == ["words"]
