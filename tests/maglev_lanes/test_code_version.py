"""Which code a stored result is bound to."""

import json
from importlib.util import find_spec
from types import SimpleNamespace

import pytest

from maglev_lanes import code_version as module
from maglev_lanes.code_version import DIAGNOSING, code_version
from tuning.comparison.twin import SPEC, compare_simulators


@pytest.fixture
def changed(tmp_path, monkeypatch):
    """`sim2real` with nothing but a file of its own and one of `blind`, of which the text is given."""
    package = tmp_path / "sim2real"
    (package / "blind").mkdir(parents=True)
    (package / "other.py").write_text("1")

    def found(name):
        return SimpleNamespace(submodule_search_locations=[str(package)]) if name == "sim2real" else find_spec(name)

    monkeypatch.setattr(module, "find_spec", found)

    def write(text):
        (package / "blind" / "regret.py").write_text(text)
        code_version.cache_clear()

    yield write
    code_version.cache_clear()


def test_the_code_of_sealed_sets_counts_where_it_makes_the_result(changed):
    found = []
    for text in ("one", "two"):
        changed(text)
        found.append((code_version(DIAGNOSING), code_version(), code_version(blind=True)))
    assert found[0][:2] == found[1][:2] and found[0][2] != found[1][2]


def test_a_comparison_on_twins_is_bound_to_the_code_that_scores_it(changed, tmp_path):
    for text in ("one", "one", "two"):
        changed(text)
        if text == "two":
            with pytest.raises(ValueError, match="another version"):
                compare_simulators([], tmp_path / "c", {"nominal": 1}, 0, {})
        else:
            compare_simulators([], tmp_path / "c", {"nominal": 1}, 0, {})
    assert json.loads((tmp_path / "c" / SPEC).read_text())["seed"] == 0
