"""The benchmarks check what they measure, and refuse to report when it is wrong."""

from multiprocessing import resource_tracker

import psutil
import pytest

from onebot_description.errors import OneBotError
from tests.benchmarks import cases, report, viewer
from tests.benchmarks.__main__ import BENCHMARKS, main
from tests.benchmarks.measuring import WrongAnswer
from tests.benchmarks.report import Result

REPORTS = {"some": [Result("cost", 1.5, 1.25), Result("speed", 12.0, at_least=10.0, unit="Hz")]}


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted({*BENCHMARKS} - {"state_publisher"}))  # the README runs it
def test_quick_run(name, capfd):
    """Every answer is right; there is no verdict on times, and no process is left."""
    resource_tracker.ensure_running()  # Python's own beside a pool; it ends with this process
    before = set(psutil.Process().children(recursive=True))
    assert main([name, "--quick"]) == 0
    printed = capfd.readouterr().out
    assert "cores" in printed and "MISSED" not in printed
    assert f"{name}: all answers were right" in printed
    after = psutil.Process().children(recursive=True)
    # Another test's browser may have started a process meanwhile.
    assert all(each in before or before.intersection(each.parents()) for each in after)


def test_display_with_wrong_answers_is_refused():
    """The error says which of the two it was, and in what."""
    case = cases.CASES[2]
    (drawn,) = case.drawn

    def moved(arrays, count):
        moved = {name: values + (values.dtype.kind == "f") for name, values in arrays.items()}
        return drawn.columns(moved, count)

    with pytest.raises(WrongAnswer, match="bare.*1000 rays.*Points3D:positions of message 0"):
        viewer.measure(case._replace(drawn=(drawn._replace(columns=moved),)), quick=True)


def test_table_in_a_readme(tmp_path):
    """What stood between the marks is replaced, as often as one likes; other rows stay."""
    readme = tmp_path / "README.md"
    readme.write_text(f"before\n{report.BEGIN}\nold\n{report.END}\nafter\n")
    report.write_section(readme, "a machine", {"other": [Result("x", 1.0)]})
    for _ in range(2):
        report.write_section(readme, "a machine", REPORTS)
        section = readme.read_text()
        assert section.startswith("before\n") and section.endswith(f"{report.END}\nafter\n")
        assert "old\n" not in section and "Rows of other benchmarks are older" in section
        assert section.count("| some | speed | 12.0 Hz | at least 10 Hz |") == 1
        assert section.count("| other | x | 1.00 |  |") == 1


def test_mistakes_are_explained(tmp_path):
    """Before anything is run, and where the table cannot be written."""
    readme = tmp_path / "README.md"
    readme.write_text("no marks\n")
    with pytest.raises(OneBotError, match='did you mean "viewer"'):
        main(["viewr"])
    with pytest.raises(OneBotError, match="mean nothing"):
        main(["viewer", "--quick", "--write", str(readme)])
    with pytest.raises(OneBotError, match="has no lines <!-- benchmarks -->"):
        report.write_section(readme, "", REPORTS)
