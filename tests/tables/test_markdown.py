from __future__ import annotations

from collections.abc import Callable

from lfobench.record import Record
from lfobench.tables.building import build_table
from lfobench.tables.exporters import export
from lfobench.tables.table import Table

EXAMPLE = """\
| Dataset | Task | bc-expert § | bc § | oril | smodice | dilo |
| :-- | :-- | --: | --: | --: | --: | --: |
| random+expert | hopper | 4.4 ± 0.6 | 45.3 ± 4.5 | 55.0 ± 22.9 | **66.6 ± 57.7 ✗1** | **100.9 ± 2.7** |
|  | halfcheetah | 4.4 ± 0.6 | 45.3 ± 4.5 | 55.0 ± 22.9 | **99.9 ± 0.8** | **100.9 ± 2.7** |
| random+few-expert | hopper | 3.6 ± 0.9 | 37.8 ± 14.0 | 45.0 ± 26.0 | **83.2 ± 28.8** | **100.9 ± 2.7** |
|  | halfcheetah | 3.6 ± 0.9 | 37.8 ± 14.0 | – | **83.2 ± 28.8** | **100.9 ± 2.7** |
"""

MARKED = """\
| Dataset | Task | bc § | oril | dilo | demonstration |
| :-- | :-- | --: | --: | --: | --: |
| random+expert | hopper | 45.3 ± 4.5 | 89.3 ± 5.0 | **100.0 ± 4.0†** | 103.3 |
|  | halfcheetah | – | **99.3 ± 4.5** | **100.0 ± 4.0** | 103.3 |
|  | walker2d | – | crashed !2 | 9.0 | 103.3 |
|  | ant | – | **6.2 ± 1.3** | **66.7 ± 57.7 ✗1 !2** | – |
"""


def test_example(example: list[Record]) -> None:
    table, _, notes = export(build_table(example), "markdown").partition("\n\n")
    assert f"{table}\n" == EXAMPLE
    assert notes.startswith("- § has access to expert actions\n- **Score**: normalised return")
    assert "gives p < 0.05." in notes


def test_every_mark(marked: Table) -> None:
    table, _, notes = export(marked, "markdown").partition("\n\n")
    assert f"{table}\n" == MARKED
    assert "- **†**: stands out with p < 0.05, and no longer when corrected by Holm over 3 rows." in notes
    assert "- **Failed**: !k marks k seeds that crashed" in notes


def test_the_mark_is_explained_only_where_it_is_used(make_record: Callable[..., Record]) -> None:
    assert "§" not in export(build_table([make_record(1.0)]), "markdown")


def test_names_cannot_break_the_table(make_record: Callable[..., Record]) -> None:
    header, _, row = export(build_table([make_record(1.0, "a|b*c_<i>\n`d`")]), "markdown").splitlines()[:3]
    assert header == r"| Dataset | Task | a\|b\*c\_\<i\> \`d\` |"
    assert row == "| random+expert | hopper | 1.0 |"
