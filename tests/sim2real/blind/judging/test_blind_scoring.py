"""The sealed check: what counts as right, the figures and their intervals, and answers that survive anything."""

import json
from dataclasses import replace
from math import inf, sqrt

import numpy as np
import pytest
from scipy.stats import binom
from sealed_sets import by_name, diagnosis, label, no_gap, seal

from maglev_env.loop.effect import EFFECTS
from maglev_lanes.code_version import DIAGNOSING, code_version
from sim2real.blind.answer import answer_all
from sim2real.blind.cases import Case, open_labels, parse_diagnosis, read_answer, seal_of
from sim2real.blind.judging import scoring
from sim2real.blind.judging.alike import ALIKE, ALWAYS, AT_ONE_SPEED, alike, alike_sets
from sim2real.blind.judging.calibration import calibration_error, debiased_error, reliability
from sim2real.blind.judging.judging import judge, merged, smallest_set


def case(kind="single", effects=("delay",), size=20.0, channels="full", speeds=(0.0,), rig="hmb_free", name="c0001"):
    size = None if kind == "none" else size
    effects = () if kind == "none" else effects
    return Case(name, kind, rig, channels, frozenset(effects), size, frozenset(speeds), {})


def answer(verdict, cause=(), **more):
    return parse_diagnosis(diagnosis(verdict, cause, **more), 30.0, "v")


SAID = {"level": 0.9, "hypotheses": [["mass"], ["delay"]]}
FAILED = replace(answer("no_gap"), error="broke", verdict="error", which=())


def test_what_has_come_into_the_library_since_a_set_was_made_is_no_longer_unknown(tmp_path):
    labels = [label(1, "unknown", ("deadband",)), label(2, "unknown", ("quadratic_probe",))]
    named, unknown = open_labels(seal(tmp_path, labels))
    assert (named.kind, named.truth) == ("single", {"deadband"}) and unknown.kind == "unknown"


def test_alike_is_symmetric_named_in_the_vocabulary_and_needs_the_channels():
    for classes in ALIKE.values():
        for members, _ in classes:
            assert members <= set(EFFECTS)
    assert set(EFFECTS) >= ALWAYS | AT_ONE_SPEED
    lags = ("delay", "sensor_lag")
    assert alike(lags, "displacement", 50, True) and not alike(lags, "no_force", 50, True)
    assert alike(("delay", "amplifier_lag"), "full", 19, True) and not alike(
        ("delay", "amplifier_lag"), "full", 21, True
    )
    assert alike(("runout", "unbalance"), "full", 50, True) and not alike(("runout", "unbalance"), "full", 50, False)
    assert not alike(("delay", "sensor_gain"), "displacement", 5, True) and alike(("mass",), "full", 50, False)
    one, other = frozenset({"delay", "sensor_gain"}), frozenset({"actuator_gain", "sensor_lag"})
    for a, b in ((one, other), (other, one)):
        assert alike_sets(a, b, "displacement", 50, True) and not alike_sets(a, b, "full", 50, True)
    assert not alike_sets(one, frozenset({"delay"}), "displacement", 50, True)
    with pytest.raises(ValueError, match="channel set 'two'"):
        alike(lags, "two", 50, True)


def test_without_a_force_the_two_gains_are_one_number_and_with_it_they_are_not():
    """Closed form: injection r and force F to the reading s = g y and the current i of m y'' = q i + F, i = r - C s."""
    w = 2j * np.pi * np.geomspace(5, 500, 30)
    plant, controller = 1 / (0.08 * w**2 - 12.5e3), 8000 + 5.2 * w

    def responses(q, g):
        loop = 1 + controller * g * q * plant
        return np.array([g * q * plant / loop, 1 / loop]), g * plant / loop

    (injected, forced), (injected_other, forced_other) = responses(5.7 * 1.2, 1.0), responses(5.7, 1.2)
    assert np.allclose(injected, injected_other, rtol=1e-12)
    assert np.abs(forced_other / forced - 1).min() > 0.19
    assert alike(("actuator_gain", "sensor_gain"), "no_force", 50, True)
    assert not alike(("actuator_gain", "sensor_gain"), "full", 50, True)


# truth, answer, and which of these hold: right (class), alone, abstained, block, one (named), second, flagged
RULES = [
    (case(), answer("explained", ["delay"]), "right alone block one"),
    (case(), answer("explained", ["amplifier_lag"]), ""),
    (case(size=15.0), answer("ambiguous", ["amplifier_lag", "delay"]), "right abstained block one"),
    (case(size=25.0), answer("ambiguous", ["amplifier_lag", "delay"]), "abstained block"),
    (case(), answer("ambiguous", ["delay", "sensor_gain"]), "abstained block"),
    (case(), answer("ambiguous", ["delay", "delay+mass"]), "abstained block one"),
    (case(), answer("ambiguous", ["delay+mass", "delay+damping"]), "block one second"),
    (case(), answer("explained", ["delay", "mass"]), "block one second"),
    (case(), answer("no_gap"), ""),
    (case(size=0.8), answer("no_gap"), "abstained"),
    (case(), answer("unexplained", blocks={"amplifier": 0.9, "controller": 0.1}), "abstained flagged"),
    (case(), answer("unexplained", blocks={"sensor": 0.3, "controller+amplifier": 0.7}), "abstained block flagged"),
    (case("none"), answer("no_gap"), "abstained"),
    (case("unknown", ["quadratic_probe"]), answer("unexplained", blocks={"controller": 1.0}), "abstained flagged"),
    (case("unknown", ["quadratic_probe"]), answer("explained", ["friction"]), ""),
    (case("pair", ["delay", "mass"]), answer("explained", ["mass", "delay"]), "right alone block one second"),
    (case("pair", ["delay", "mass"]), answer("explained", ["mass"]), "block one"),
    (
        case("pair", ["delay", "mass"], channels="displacement"),
        answer("ambiguous", ["delay+mass", "sensor_lag+mass"]),
        "right abstained block one second",
    ),
    (case(), FAILED, "second"),
]
WORDS = {
    "right": "right_class",
    "alone": "alone",
    "abstained": "abstained",
    "block": "right_block",
    "one": "one_named",
    "second": "second",
    "flagged": "flagged",
}


@pytest.mark.parametrize(("truth", "given", "expected"), RULES)
def test_what_counts_as_right(truth, given, expected):
    judged = judge(truth, given)
    assert {word for word, name in WORDS.items() if getattr(judged, name)} == set(expected.split())
    assert judged.false_alarm == (given.verdict != "no_gap")


def test_none_and_calibration_are_one_hypothesis_and_the_set_is_the_smallest():
    given = answer("no_gap", which={"delay": 0.42, "none": 0.25, "calibration": 0.2, "mass": 0.13})
    assert merged(given)[0] == (frozenset({"none"}), pytest.approx(0.45))
    right = judge(case("none"), given)
    assert right.top_right and right.top_probability == pytest.approx(0.45) and right.covered
    assert smallest_set(merged(given)) == {frozenset({n}) for n in ("none", "delay", "mass")}
    assert smallest_set([(frozenset({"a"}), 0.9), (frozenset({"b"}), 0.1)]) == {frozenset({"a"})}
    assert not judge(case(effects=["damping"]), given).covered
    # Where a diagnosis knows of no set, it counts by the probabilities that it states; a set that it says is its own.
    none_said, said = (parse_diagnosis(diagnosis("no_gap") | {"likely": one}, 1.0, "v") for one in (None, SAID))
    assert none_said.likely is None and judge(case("none"), none_said).covered
    assert judge(case(effects=["mass"]), said).covered and not judge(case("none"), said).covered
    failed = judge(case("none"), FAILED)
    assert failed.false_alarm and not failed.covered and not failed.top_right and failed.top_probability == 1


def test_shares_carry_wilsons_interval_and_it_covers():
    share = scoring.SHARES[0]
    alarms = [judge(case("none"), answer("explained", ["delay"]))] * 3 + [judge(case("none"), answer("no_gap"))] * 57
    row = scoring.share_row(share, alarms)
    p, n, z = 3 / 60, 60, 1.959964
    middle, half = (p + z**2 / (2 * n)), z * sqrt(p * (1 - p) / n + z**2 / (4 * n**2))
    expected = [(middle + sign * half) / (1 + z**2 / n) for sign in (-1, 1)]
    assert (row.value, row.n) == (p, n) and [row.low, row.high] == pytest.approx(expected, rel=1e-5)
    assert row.verdict == "floor" and not row.decided  # at the floor of 5 %, and the interval holds it
    wrong, fine = alarms[0], alarms[-1]
    for share_true in (0.05, 0.5, 0.9):
        inside = 0.0
        for k in range(41):
            r = scoring.share_row(share, [wrong] * k + [fine] * (40 - k))
            inside += binom.pmf(k, 40, share_true) * (r.low <= share_true <= r.high)
        assert 0.92 < inside < 0.99, share_true


@pytest.mark.slow
@pytest.mark.parametrize("statistic", [np.median, np.mean])
def test_bootstrap_intervals_cover(statistic):
    rng, inside = np.random.default_rng(3), 0
    for _ in range(80):
        low, high = scoring.bootstrap(rng.exponential(size=40), statistic)
        inside += low <= (np.log(2) if statistic is np.median else 1.0) <= high
    assert 0.87 <= inside / 80 <= 0.99  # two standard errors about 0.93, what a percentile interval of 40 gives


def test_calibration_error_is_what_is_overstated():
    rng = np.random.default_rng(1)
    stated = rng.uniform(0.3, 1.0, 200_000)
    for lie in (0.0, 0.2):
        top = np.column_stack([stated, rng.uniform(size=stated.size) < stated - lie])
        assert calibration_error(top) == pytest.approx(lie, abs=0.006)
    few = reliability(np.array([[1.0, 1.0], [0.95, 0.0], [0.15, 0.0]]))
    assert (
        list(few.count) == [1, 2]
        and few.stated == pytest.approx([0.15, 0.975])
        and few.right == pytest.approx([0, 0.5])
    )
    assert calibration_error(np.array([[1.0, 1.0], [0.95, 0.0], [0.15, 0.0]])) == pytest.approx((0.15 + 2 * 0.475) / 3)


def test_the_debiased_calibration_error_is_that_of_many_cases():
    """Of a hundred cases chance alone makes a calibration error of 0.08."""
    rng = np.random.default_rng(2)
    found = {lie: [] for lie in (0.0, 0.2)}
    for lie, errors in found.items():
        for _ in range(400):
            stated = rng.uniform(0.3, 1.0, 112)
            top = np.column_stack([stated, rng.uniform(size=112) < stated - lie])
            errors.append((debiased_error(top), calibration_error(top)))
    (true, biased), (far, _) = (np.mean(np.square(found[lie]), axis=0) ** 0.5 for lie in found)
    assert biased > 0.08 and true < 0.06 and far == pytest.approx(0.2, abs=0.02)


def _mixed():
    """A set of every kind, size, rig and channel set."""
    names = sorted(EFFECTS)
    found = []
    for i in range(120):
        kind = ("single", "none", "single", "pair", "single", "unknown")[i % 6]
        effects = [names[i % len(names)], names[(i + 7) % len(names)]][: 2 if kind == "pair" else 1]
        size = float(np.geomspace(0.5, 100, 40)[(i // 3) % 40])
        found.append(
            case(kind, effects, size, sorted(ALIKE)[i % 3], rig=("hmb_free", "stand")[i // 60], name=f"c{i:04d}")
        )
    return found


def _oracle(truth):
    if truth.kind == "unknown":
        return answer("unexplained", which={"unknown": 0.9, "delay": 0.1}, blocks={"sensor": 1.0})
    if truth.kind == "none":
        return answer("no_gap", which={"none": 0.5, "calibration": 0.4, "delay": 0.1})
    named = sorted(truth.effects)
    return answer("explained", named, which={"+".join(named): 0.9, "none": 0.1})


def test_an_oracle_reaches_every_target_and_one_who_says_nothing_or_everything_misses():
    cases = _mixed()
    good = {r.name: r for r in scoring.rows([judge(c, _oracle(c)) for c in cases])}
    coverage = good.pop("90 % set holds the truth")
    assert coverage.value == 1 and coverage.verdict == "floor"  # sets that always hold it are too wide for "ambitious"
    error = good.pop("calibration error")
    assert error.value == pytest.approx(0.1)  # right always, says 0.9
    assert {r.verdict for r in good.values() if r.target} == {"ambitious"} and all(r.n for r in good.values())
    silent = {r.name: r for r in scoring.rows([judge(c, answer("no_gap")) for c in cases])}
    everything = answer("ambiguous", sorted(EFFECTS))
    vague = {r.name: r for r in scoring.rows([judge(c, everything) for c in cases])}
    for rows in (silent, vague):
        for name in ("right class, >= 10 x", "pairs: both named", "unknown flagged"):
            assert rows[name].value == 0 and rows[name].verdict == "missed" and rows[name].decided
    assert silent["false alarm"].value == 0 and vague["false alarm"].value == 1
    assert silent["right class or correct abstention, 1-10 x"].value == 0
    none_right = silent["median closed fraction, >= 10 x"]
    assert none_right.n == 0 and none_right.verdict == "no cases"


def test_parts_share_out_the_whole():
    judged = [judge(c, _oracle(c)) for c in _mixed()]
    for part in (lambda j: j.case.channels, lambda j: j.case.rig):
        whole, parts = scoring.rows(judged), scoring.by(judged, part)
        for i, row in enumerate(whole):
            assert sum(rows[i].n for rows in parts.values()) == row.n
    sized = scoring.by_size(judged)
    assert list(sized) == ["< 1 x", "1-10 x", ">= 10 x"]
    singles = sum(j.case.kind == "single" for j in judged)
    assert sum(rows[0].n for rows in sized.values()) == singles and sized[">= 10 x"][0].name == "right class"
    assert sum(scoring.confusion(judged).values()) == len(judged)
    assert set(scoring.named_in_class(judged)) == {1}


def test_a_target_is_judged_on_its_own_side_of_the_floor():
    target = scoring.Target(180.0, (0.0, 60.0), True)
    for value, verdict in ((59.0, "ambitious"), (61.0, "floor"), (181.0, "missed")):
        assert scoring.row("t", value, (value - 1, value + 1), 5, "s", target).verdict == verdict
    between = scoring.Target(0.85, (0.88, 0.93))
    assert [scoring.row("c", v, (v, v), 9, "", between).verdict for v in (0.84, 0.86, 0.9, 0.95)] == [
        "missed",
        "floor",
        "ambitious",
        "floor",
    ]
    assert scoring.row("c", 0.9, (0.86, 0.94), 9, "", between).decided
    assert scoring.row("r", -0.6, (-inf, 0.1), 9, "share", scoring.REGRET_TARGET).verdict == "floor"


def test_labels_are_only_scored_when_they_are_the_sealed_ones(tmp_path):
    folder = seal(
        tmp_path, [label(1), label(2, "none", ()), label(3, "pair", ("delay", "mass"), (5.0, 3.0))], (0, 3000)
    )
    first, second, third = open_labels(folder)
    assert (first.truth, second.truth, third.size) == (frozenset({"delay"}), frozenset({"none"}), 3.0)
    assert second.size is None and first.speeds == {0.0, 3000.0}
    path = folder / "labels.json"
    path.write_text(path.read_text().replace("delay", "mass"))
    with pytest.raises(ValueError, match="changed"):
        open_labels(folder)
    with pytest.raises(ValueError, match="generate"):
        seal_of(tmp_path / "campaigns")
    with pytest.raises(ValueError, match="'gremlins' is not in the vocabulary"):
        open_labels(seal(tmp_path / "b", [label(1, effects=("gremlins",))]))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"verdict": "maybe"}, "verdict 'maybe'"),
        ({"cause": ["gremlins"]}, "gremlins"),
        ({"which": [{"effects": ["delay"], "probability": 0.7}]}, "sum to one"),
        ({"which": [{"effects": ["gremlins"], "probability": 1.0}]}, "gremlins"),
    ],
)
def test_an_answer_of_another_form_is_refused(change, message):
    with pytest.raises(ValueError, match=message):
        parse_diagnosis(diagnosis("explained", ["delay"]) | change, 1.0, "v")


def test_answers_are_given_without_labels_kept_and_given_anew_by_other_code(tmp_path):
    folder = seal(tmp_path, [label(i) for i in range(3)])
    (folder / "labels.json").rename(tmp_path / "elsewhere")
    done = []
    first = answer_all(folder, 1, done.append, no_gap)
    assert (first.new, first.reused, first.failed) == (3, 0, 0) and sum(done) == 3
    (folder / "answers" / "c0001.json").write_text("{ half")
    again = answer_all(folder, 1, None, no_gap)
    assert (again.new, again.reused) == (1, 2)
    path = folder / "answers" / "c0002.json"
    data = json.loads(path.read_text())
    assert data["version"] == code_version(DIAGNOSING) and data["labels_sha256"] == seal_of(folder)
    path.write_text(json.dumps(data | {"version": "0.0.1+other"}))
    assert answer_all(folder, 1, None, no_gap).new == 1
    assert json.loads(path.read_text())["version"] == code_version(DIAGNOSING)
    with pytest.raises(ValueError, match="missing"):
        read_answer(folder / "answers" / "c0009.json", seal_of(folder))
    with pytest.raises(ValueError, match="does not answer this"):
        read_answer(path, "0" * 64)
    (folder / "blind.json").write_text("{}")
    assert answer_all(folder, 1, None, no_gap).reused == 3  # nothing left to do
    path.unlink()
    with pytest.raises(ValueError, match="opened already"):
        answer_all(folder, 1, None, no_gap)


@pytest.mark.slow
def test_a_diagnosis_that_fails_or_dies_is_a_wrong_answer_and_the_others_are_given(tmp_path):
    folder = seal(tmp_path, [label(i) for i in range(8)])
    found = answer_all(folder, 2, None, by_name)
    assert (found.new, found.failed) == (8, 6)
    errors = [read_answer(folder / "answers" / f"c{i:04d}.json", seal_of(folder)).error for i in range(8)]
    assert errors[0] is None and errors[4] is None and "does not stand" in errors[1] and "gremlins" in errors[2]
    assert errors[3] == errors[7] == "its process died"
    assert answer_all(folder, 2, None, by_name).reused == 8
