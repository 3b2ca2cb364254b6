from __future__ import annotations

from collections.abc import Callable

from lfobench.contract.record import Record
from lfobench.render.building import build_table
from lfobench.render.formats import export

EXAMPLE = """\
| Dataset | Task | bc-expert § | bc § | oril | smodice | dilo |
| :-- | :-- | --: | --: | --: | --: | --: |
| random+expert | hopper | 4.4 ± 0.6 | 45.3 ± 4.5 | 55.0 ± 22.9 | **66.6 ± 57.7 ✗1** | **100.9 ± 2.7** |
|  | halfcheetah | 4.4 ± 0.6 | 45.3 ± 4.5 | 55.0 ± 22.9 | **99.9 ± 0.8** | **100.9 ± 2.7** |
| random+few-expert | hopper | 3.6 ± 0.9 | 37.8 ± 14.0 | 45.0 ± 26.0 | **83.2 ± 28.8** | **100.9 ± 2.7** |
|  | halfcheetah | 3.6 ± 0.9 | 37.8 ± 14.0 | – | **83.2 ± 28.8** | **100.9 ± 2.7** |
"""


def test_example(example: list[Record]) -> None:
    table, _, notes = export(build_table(example), "markdown").partition("\n\n")
    assert f"{table}\n" == EXAMPLE
    assert notes.startswith("- § has access to expert actions\n- **Score**: normalised return")
    assert "gives p < 0.05." in notes


def test_the_mark_is_explained_only_where_it_is_used(make_record: Callable[..., Record]) -> None:
    assert "§" not in export(build_table([make_record(1.0)]), "markdown")


def test_names_cannot_break_the_table(make_record: Callable[..., Record]) -> None:
    header, _, row = export(build_table([make_record(1.0, "a|b*c_<i>\n`d`")]), "markdown").splitlines()[:3]
    assert header == r"| Dataset | Task | a\|b\*c\_\<i\> \`d\` |"
    assert row == "| random+expert | hopper | 1.0 |"
