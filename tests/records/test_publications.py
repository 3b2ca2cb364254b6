"""Reading publications: by name, from a file, and every mistake in one."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from lfobench.errors import UserError
from lfobench.records.publication import PrintedCount, PrintedMean, TableOfCounts, TableOfMeans
from lfobench.records.published import publication_names, read_publication

MEANS = "env,method,mean,std,highlighted\n"
COUNTS = "task,method,successes,trials\n"


def write(folder: Path, text: str | bytes) -> str:
    file = folder / "table.csv"
    file.write_bytes(text.encode() if isinstance(text, str) else text)
    return str(file)


def refusal(name_or_path: str) -> str:
    with pytest.raises(UserError) as refused:
        read_publication(name_or_path)
    assert refused.value.remedy
    return str(refused.value)


def test_a_shipped_publication_is_found_from_any_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert "dilo-2024" in publication_names()
    assert read_publication("dilo-2024").name == "dilo-2024"


def test_a_table_of_means(tmp_path: Path) -> None:
    publication = read_publication(
        write(tmp_path, "method,env,mean,std,n,data,highlighted\ndilo,hopper,97.90,8,5,few,1\nbc,hopper,-.5,,3,few,\n")
    )
    (table,) = publication.tables
    assert publication.name == "table"
    assert isinstance(table, TableOfMeans)
    (row,) = table.rows
    assert (row.name, row.place) == ("hopper-few", {"env": "hopper", "data": "few"})
    assert row.cells == {
        "dilo": PrintedMean(97.9, 8.0, 0.01, 1.0, 5, True),
        "bc": PrintedMean(-0.5, None, 0.1, None, 3, None),
    }


def test_a_table_of_successes(tmp_path: Path) -> None:
    (table,) = read_publication(write(tmp_path, COUNTS + "reach,dilo,8,10\nreach,bc,0,10\npush,dilo,1,1\n")).tables
    assert isinstance(table, TableOfCounts)
    assert [row.name for row in table.rows] == ["reach", "push"]
    assert table.rows[0].cells == {"dilo": PrintedCount(8, 10, None), "bc": PrintedCount(0, 10, None)}


def test_what_spreadsheets_write_is_read(tmp_path: Path) -> None:
    text = '\ufeffenv, method, mean, std\r\n"hopper", dilo, 1.5, 0.5\r\n\r\n'
    (table,) = read_publication(write(tmp_path, text)).tables
    assert table.rows[0].cells["dilo"] == PrintedMean(1.5, 0.5, 0.1, 0.1, None, None)


@pytest.mark.parametrize(
    "text",
    [
        "method\tmean\tstd\tn\ttask\ndilo\t50.5\t2.0\t5\thopper\nsmodice\t-47.25\t1.0\t5\thopper\n",
        "method;mean;std;n;task\r\ndilo;50,5;2,0;5;hopper\r\nsmodice;-47,25;1,0;5;hopper\r\n",
        'method,mean,std,n,task\n"dilo","50,5","2,0",5,"hopper"\nsmodice,"-47,25","1,0",5,hopper\n',
        "\ufeffmethod,mean,std,n,task\ndilo,50.5,2.0,5,hopper\nsmodice,\u221247.25,1.0,5,hopper\n",
        "method,mean,std,n,task\rdilo,\u00a050.5,2.0\u00a0,5,hopper\rsmodice,-47.25,1.0,5,hopper\r",
    ],
    ids=["tabs", "semicolons and decimal commas", "quoted decimal commas", "mark and U+2212", "no-break spaces and CR"],
)
def test_other_spellings_of_the_same_table_are_read(tmp_path: Path, text: str) -> None:
    (table,) = read_publication(write(tmp_path, text)).tables
    (row,) = table.rows
    assert (row.name, row.cells) == (
        "hopper",
        {
            "dilo": PrintedMean(50.5, 2.0, 0.1, 0.1, 5, None),
            "smodice": PrintedMean(-47.25, 1.0, 0.01, 0.1, 5, None),
        },
    )


def test_an_unknown_name_offers_the_closest_and_a_file() -> None:
    assert "Did you mean 'dilo-2024'?" in refusal("dilo-2023")
    assert "method, mean, std" in refusal("zzz")


def test_what_is_no_file_is_refused(tmp_path: Path) -> None:
    assert str(tmp_path / "absent.csv") in refusal(str(tmp_path / "absent.csv"))
    assert "is a folder" in refusal(str(tmp_path))
    assert "Cannot read" in refusal("x" * 300)


@pytest.mark.parametrize(
    ("text", "line", "named"),
    [
        ("env,method,mean\nhopper,dilo,1\n", 1, "env, method, mean"),
        ("env,method,mean,std,successes,trials\nhopper,dilo,1,1,1,1\n", 1, "both"),
        ("env,mean,std\nhopper,1,1\n", 1, "method, mean, std"),
        ("env,env,method,mean,std\nhopper,hopper,dilo,1,1\n", 1, "two columns 'env'"),
        (",,method,mean,std\nhopper,hopper,dilo,1,1\n", 1, "without a name"),
        (MEANS + "hopper,dilo,1,1,1\nhopper,oril,many,1,0\n", 3, "'many'"),
        (MEANS + "hopper,dilo,nan,1,1\n", 2, "finite"),
        (MEANS + "hopper,dilo,inf,1,1\n", 2, "finite"),
        (MEANS + "hopper,dilo,1e999,1,1\n", 2, "finite"),
        (MEANS + "hopper,dilo,1_0,1,1\n", 2, "finite"),
        (MEANS + "hopper,dilo,1,1.0*,1\n", 2, "std is '1.0*'"),
        (MEANS + "hopper,dilo,97.9 ± 8.1,,1\n", 2, "97.9 ± 8.1"),
        (MEANS + "hopper,dilo,97.9+-8.1,,1\n", 2, "mean and std"),
        (MEANS + "hopper,dilo,97.9 +/- 8.1,,1\n", 2, "mean and std"),
        (MEANS + "hopper,dilo,97.9%,1,1\n", 2, "'97.9%'"),
        (MEANS + "hopper,dilo,12\u00a0135,1,1\n", 2, "'12 135'"),
        (MEANS + "hopper,dilo,1e300,1,1\n", 2, "beyond ±1.0e15"),
        (MEANS + "hopper,dilo,1,2e15,1\n", 2, "std is '2e15'"),
        (",env,method,mean,std\n0,hopper,dilo,1,1\n", 1, "number 1 of 5"),
        ("Unnamed: 0,env,method,mean,std\n0,hopper,dilo,1,1\n", 1, "'Unnamed: 0'"),
        ("id,env,method,mean,std\n0,hopper,dilo,1,1\n1,hopper,bc,1,1\n", 1, "column 'id'"),
        ("env\tmethod\tmean\tstd\nhopper\tdilo\t12,135\t3\n", 2, "'12,135'"),
        ("env;method;mean;std\nhopper;dilo;1,5;3\nhopper;bc;1.5;2\n", 3, "'1.5'"),
        (MEANS + "hopper,dilo,1,-1,1\n", 2, "not negative"),
        (MEANS + "hopper,dilo,,1,1\n", 2, "mean is empty"),
        (MEANS + "hopper,,1,1,1\n", 2, "method is empty"),
        (MEANS + ",dilo,1,1,1\n", 2, "env is empty"),
        (MEANS + "hopper,dilo,1,1,yes\n", 2, "highlighted is 'yes'"),
        (MEANS + "hopper,dilo,1,1\n", 2, "4 fields"),
        (MEANS + "hopper,dilo,1,1,1\nhopper,dilo,2,1,0\n", 3, "dilo for hopper"),
        ("env,method,mean,std,n\nhopper,dilo,1,1,0\n", 2, "at least 1"),
        ("env,method,mean,std,n\nhopper,dilo,1,1,2.5\n", 2, "whole number"),
        ("env,method,mean,std,n\nhopper,dilo,1,1,\n", 2, "n is empty"),
        (COUNTS + "reach,dilo,11,10\n", 2, "11 successes"),
        (COUNTS + "reach,dilo,-1,10\n", 2, "whole number"),
        (COUNTS + "reach,dilo,0,0\n", 2, "at least 1"),
        (COUNTS + "reach,dilo,,10\n", 2, "successes is empty"),
        (COUNTS + 'reach,"dilo,1,10\n', 2, "not CSV"),
        (COUNTS + "reach,dilo\x1b[2J,1,10\n", 2, r"'dilo\x1b[2J'"),
    ],
)
def test_every_mistake_names_the_file_and_the_line(tmp_path: Path, text: str, line: int, named: str) -> None:
    found = refusal(write(tmp_path, text))
    assert f"table.csv, line {line}:" in found
    assert named in found


def test_files_without_lines_to_name(tmp_path: Path) -> None:
    assert "is empty" in refusal(write(tmp_path, ""))
    assert "no line below" in refusal(write(tmp_path, MEANS))
    assert "UTF-8" in refusal(write(tmp_path, MEANS.encode() + b"hopper,dil\xf6,1,1,1\n"))
    assert "UTF-8" in refusal(write(tmp_path, MEANS.encode("utf-16")))


@given(
    st.binary(max_size=80)
    | st.text("mean,std\n\"'0123.-e", max_size=60).map(lambda text: MEANS.encode() + text.encode())
)
@hypothesis_settings(max_examples=150)
def test_no_file_breaks_the_reader(tmp_path_factory: pytest.TempPathFactory, content: bytes) -> None:
    file = tmp_path_factory.getbasetemp() / "any.csv"
    file.write_bytes(content)
    try:
        publication = read_publication(str(file))
    except UserError as refused:
        assert str(file) in refused.problem
    else:
        assert publication.tables[0].rows


@pytest.mark.parametrize("kind", ["pipe", "endless", "large"])
def test_what_is_no_table_is_not_waited_for(kind: str, tmp_path: Path) -> None:
    file = tmp_path / "table.csv"
    if kind == "pipe":
        os.mkfifo(file)
    elif kind == "endless":
        file.symlink_to("/dev/zero")
    else:
        with file.open("wb") as sparse:
            sparse.truncate(2 * 10**9)
    found = refusal(str(file))
    assert str(file) in found
    assert ("2,000,000,000 bytes" if kind == "large" else "not a regular file") in found
