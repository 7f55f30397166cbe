"""The mutants of `tests/tools/mutants.py` outlive files that move: each finds its text and its tests in this tree."""

import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "tests" / "tools"))


def test_every_mutant_finds_its_place_and_its_tests():
    from mutants import locate, product_files, test_files
    from mutants_list import MUTANTS
    from mutants_sampled import sampled

    files = product_files(ROOT)
    wrong = {m.name: place for m in MUTANTS if isinstance(place := locate(m, files), str)}
    drawn = sampled(ROOT)  # refuses a target that has moved
    by_tests = {m.tests: m for m in (*MUTANTS, *drawn)}
    wrong |= {m.name: said for m in by_tests.values() if isinstance(said := test_files(ROOT, m), str)}
    assert wrong == {} and len(drawn) > 200
