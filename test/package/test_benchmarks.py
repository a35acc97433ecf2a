"""docs/BENCHMARKS.md is made of what the benchmarks write; none is called in vain."""

import json
import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "benchmarks"))
bench = __import__("all")  # whose name is that of a function


def test_every_program_knows_the_options_it_is_called_with():
    programs = {path.name for path in (ROOT / "benchmarks").glob("*.py")}
    called = bench.here()
    assert {Path(b.arguments[0]).name for b in called.values()} <= programs
    for benchmark in called.values():
        source = (ROOT / benchmark.arguments[0]).read_text(encoding="utf-8")
        for option in re.findall(r"--\w+", " ".join(benchmark.arguments)):
            assert f'"{option}"' in source, (benchmark.arguments[0], option)


@pytest.mark.parametrize(
    ("numbers", "expected"),
    [
        ({"demo": [{"a": 1.23456, "b|": "x"}, {"a": 2.0}]}, ["| a | b\\| |", "| 1.235 | x |"]),
        ([{"case": "one", "good": 0.5, "all": [1, 2]}], ["| case | good |", "| one | 0.5 |"]),
        ({"early": {"ms": 2.0}, "late": {"ms": 3.0}}, ["|  | ms |", "| early | 2 |"]),
        ({"growth": {"MB": 0.1}, "rows": [{"n": 5}]}, ["| growth | 0.1 |", "| 5 |"]),
    ],
)
def test_numbers_become_tables(tmp_path, numbers, expected):
    name, benchmark = next(iter(bench.here().items()))
    (tmp_path / benchmark.numbers).parent.mkdir(exist_ok=True)
    (tmp_path / benchmark.numbers).write_text(json.dumps(numbers))
    page = bench.page(tmp_path)
    assert f"    python benchmarks/{name}.py" in page
    assert str(tmp_path) not in page
    for line in expected:
        assert f"{line}\n" in page + "\n"


def test_what_stands_above_the_tables_is_kept_and_the_tables_are_not(tmp_path):
    first = bench.page(tmp_path, "# Mine\n\nby hand\n\n")
    assert first.startswith("# Mine\n\nby hand\n")
    assert bench.page(tmp_path, first + "\nstale\n") == first


def test_of_many_rows_some_are_shown():
    rows = [{"k": k} for k in range(1000)]
    assert len(list(bench.markdown(rows))) <= 2 + 40
