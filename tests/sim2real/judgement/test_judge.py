"""What evidence makes believable: hand-made costs and groups, of which the answer is plain."""

from dataclasses import replace
from math import inf
from types import MappingProxyType

import numpy as np
import pytest

from maglev_env.loop.effect import EFFECTS
from maglev_env.rig.rig_file import load_rig
from sim2real.compared.point import Point
from sim2real.judgement import judge as judge_module
from sim2real.judgement.belief import Judge
from sim2real.judgement.dispersion import ChiSquare, Dispersion
from sim2real.judgement.evidence import IDLE, Evidence, idle_cost
from sim2real.judgement.judge import HOPELESS, Entry, allowance, entries, reach
from sim2real.judgement.verdict import verdict

SINGLES = ("delay", "amplifier_lag", "actuator_gain", "mass", "friction", "saturation")
GROUPS = tuple(("plant", kind, f) for kind in ("force", "current", "even", "odd") for f in (16.0, 64.0, 256.0))
COUNT = 40  # complex residuals in a group
EXPECTED = 2.0 * COUNT * len(GROUPS)


@pytest.fixture(autouse=True)
def _plain(monkeypatch):
    """The constants of the code, not those that were learned last."""
    monkeypatch.setattr(judge_module, "shipped", Judge)


def evidence(costs=None, nominal=None, excess=None, pairs=None, tones=None, spin=None) -> Evidence:
    """Costs beyond the expected one: of calibration under "", singles, and pairs "a+b"; excess (G,) of each, by
    default the cost evenly spread."""
    table = {"": 0.0, **dict.fromkeys(SINGLES, 0.0), **(costs or {}), **(pairs or {})}
    cost = np.array(list(table.values()))
    shared = {name: np.full(len(GROUPS), c / len(GROUPS)) for name, c in table.items()} | (excess or {})
    names = tuple(tuple(filter(None, name.split("+"))) for name in table)
    found = np.nan_to_num(np.array([shared[n] for n in table]), posinf=0.0)
    beyond = table[""] if nominal is None else nominal
    scatter = np.full(len(GROUPS), 1.5 * np.sqrt(4.0 * COUNT))
    return Evidence(names, EXPECTED + cost, EXPECTED + beyond, found, scatter, GROUPS, tones or {}, spin or {})


def gap(size, pairs=None, **left) -> Evidence:
    """A gap of so much cost that each named effect leaves that much of, and every other one all of."""
    return evidence({"": size, **dict.fromkeys(SINGLES, size), **left}, pairs=pairs)


def probability(found: list[Entry], *effects: str) -> float:
    return sum(e.probability for e in found if e.effects == effects)


def judged(e: Evidence):
    return verdict(entries(e))


def test_an_effect_that_allows_for_more_is_believed_less():
    """Friction may leave 5 % of what it explains and a delay nothing: fitting hardly better does not name friction."""
    assert judged(gap(1e5, delay=5.0, friction=0.0)) == ("explained", ("delay",))
    assert judged(gap(1e5, delay=1e3, friction=0.0)) == ("explained", ("friction",))


def test_what_two_effects_save_is_shared_among_them():
    """Of two that may stand for each other either saves little beside the other. What both save may still be in another
    form than both have: of friction and saturation, at least the smaller of their shares."""
    both = {"friction+saturation": 0.0}
    alike = evidence({"": 1e5, **dict.fromkeys(SINGLES, 1e5), "friction": 50.0, "saturation": 50.0}, pairs=both)
    apart = evidence({"": 1e5, **dict.fromkeys(SINGLES, 1e5), "friction": 6e4, "saturation": 6e4}, pairs=both)
    shares = [EFFECTS[name].form_share for name in ("friction", "saturation")]
    base = Judge().belief.form_share * 1e5
    assert allowance(alike) == pytest.approx(Judge().belief.leftover * (base + min(shares) * 1e5))
    assert allowance(apart) == pytest.approx(Judge().belief.leftover * (base + sum(shares) * 6e4))


@pytest.mark.parametrize(("left", "named"), [(0.0, ("saturation", "delay")), (300.0, ("saturation",))])
def test_a_second_effect_that_takes_the_residue_away_is_not_a_matter_of_form(left, named):
    """A saturation leaves 140 of 48,000, of which another form of it may leave 2,400, and a delay takes that away."""
    found = judged(gap(48e3, saturation=140.0 + left, pairs={"saturation+delay": left}))
    assert found == ("explained", named)


@pytest.mark.parametrize(("left", "named"), [(3000.0, ("saturation", "delay")), (500.0, ("saturation",))])
def test_beside_a_gap_of_any_size_what_stands_far_out_of_the_noise_is_no_matter_of_form(left, named):
    """The noise of all groups scatters by 66; another form of the saturation may leave two million of 200 million."""
    assert judged(gap(2e8, saturation=left, pairs={"saturation+delay": 0.0})) == ("explained", named)


def test_a_law_of_force_may_be_that_of_an_unknown_cause():
    """What has a name of its own, as a delay has, is not as easily something else."""
    believed = replace(Judge(), belief=replace(Judge().belief, unknown_cost=4.0, unknown_alike=1.0))
    for name, odds in (("friction", 1.0), ("delay", 4.0)):
        found = entries(gap(400.0, **{name: 0.0}), believed)
        ratio = probability(found, name) / probability(found, "unknown")
        assert found[0].effects == (name,) and np.log(ratio) == pytest.approx(odds, abs=0.1)


@pytest.mark.parametrize(("motion", "named"), [(inf, "friction"), (1e6, "unknown")])
def test_no_form_is_excused_a_share_of_more_than_the_motion(motion, named):
    """A rotor that nearly falls without an effect moves far more than it was seen to."""
    found = entries(replace(gap(1e9, friction=4e5), motion=motion))
    assert found[0].effects == (named,)


def test_what_is_excused_names_no_worse_explanation():
    """A delay of a ball with which friction saves little by chance; a lag of any form leaves more than the delay."""
    size, rest = 2e6, {"delay": 120.0, "friction": 4e5}
    found = entries(gap(size, **rest, amplifier_lag=160.0, pairs={"delay+friction": 0.0}))
    kind, cause = verdict(found)
    assert cause[0] == "delay" and kind == "ambiguous" and "amplifier_lag" in cause
    assert probability(found, "delay") >= probability(found, "amplifier_lag") > 0.3
    # A lag that explains more is still named, whatever its form.
    assert judged(gap(size, **(rest | {"delay": 1e3}), amplifier_lag=160.0, pairs={"delay+friction": 800.0})) == (
        "explained",
        ("amplifier_lag",),
    )


@pytest.mark.parametrize(("strain", "named"), [(0.0, False), (100.0, True)])
def test_what_contradicts_the_rig_lends_its_excuse_to_nothing(strain, named):
    """A lag with impossible masses is not named whatever its form may leave; a delay is no more likely for it."""
    e = gap(2e6, pairs={"amplifier_lag+mass": 0.0}, delay=450.0, saturation=550.0 + strain)
    strained = np.array([strain if names == ("saturation",) else 0.0 for names in e.effects])
    assert (probability(entries(replace(e, strain=strained)), "amplifier_lag", "mass") > 0.5) == named


def test_beside_an_unknown_cause_what_explains_most_comes_first_however_it_bends_the_rig():
    """Iron and a delay: beside the delay, mass and gains took up what the iron does. Lost commands explain less."""
    e = gap(5e5, delay=400.0, friction=1.1e5)
    strain = np.array([{("delay",): 300.0, ("friction",): 130.0}.get(names, 500.0) for names in e.effects])
    bad = Dispersion(ChiSquare(EXPECTED + 2e4, EXPECTED), ChiSquare(0.0, 0.0))
    found = entries(replace(e, cost=e.cost + strain, strain=strain, dispersion=bad))
    assert found[0].effects == ("unknown",) and found[0].probability > 0.999
    assert found[1].effects == ("delay",)


@pytest.mark.parametrize("seed", range(6))
def test_probabilities_sum_to_one_and_fall(seed):
    rng = np.random.default_rng(seed)
    costs = {name: float(rng.exponential(300.0)) for name in ("", *SINGLES)} | {"mass": np.inf}
    tones = {"pickup": 80.0, "spin": 30.0, "foreign": 20.0} if seed % 2 else {}
    spin = {"runout": 3.0, "unbalance": 60.0} if seed % 2 else {}
    found = entries(evidence(costs, pairs={"delay+friction": 10.0}, tones=tones, spin=spin))
    p = np.array([e.probability for e in found])
    assert p.sum() == pytest.approx(1.0, abs=1e-12) and (p >= 0).all() and (np.diff(p) <= 0).all()
    assert {("none",), ("calibration",), ("unknown",)} <= {e.effects for e in found}
    assert not any("mass" in e.effects for e in found)  # it touches down


def test_what_explains_nothing_is_excused_nothing():
    """A stated gain far off its data sheet costs what explains all of the gap 90. That a hysteresis which explains
    nothing could have another form makes no cause of the gain that explains as little."""
    resonances = {"sensor_resonance+support_resonance": 0.0}
    e = gap(1e4, pairs=resonances, actuator_gain=1.01e4, hysteresis=1.02e4)
    strain = np.array([0.0 if "actuator_gain" in names else 90.0 for names in e.effects])
    found = entries(replace(e, strain=strain))
    assert probability(found, "actuator_gain") < 0.01 and probability(found, "unknown") > 0.5


def test_noise_is_no_gap():
    """k parameters that fit noise save a chi-square of k, and lose as much, 2 k on the mean, on what they predict."""
    rng = np.random.default_rng(1)
    alarms = 0
    for _ in range(300):
        costs = {name: 2.0 * k - float(rng.chisquare(k)) for name, k in zip(SINGLES, (1, 1, 1, 1, 2, 1), strict=True)}
        scatter = np.sqrt(4.0 * COUNT) * rng.standard_normal(len(GROUPS))
        e = evidence(costs, nominal=float(rng.chisquare(5)))
        e = replace(e, excess=e.excess + scatter)
        alarms += judged(e) != ("no_gap", ())
    assert alarms <= 15  # 5 %


def test_a_gap_that_calibration_closes_is_none():
    found = entries(evidence(nominal=900.0))
    assert verdict(found) == ("no_gap", ()) and found[0].effects == ("calibration",)
    assert probability(found, "none") < 1e-3


def test_the_effect_that_closes_a_gap_is_named():
    found = entries(gap(5e4, delay=0.0))
    assert verdict(found) == ("explained", ("delay",))
    assert probability(found, "delay") > 0.9 and found[0].explained_worst_group > 0.99


def test_equals_share_and_are_a_class():
    found = entries(gap(5e4, delay=0.0, amplifier_lag=0.0))
    assert probability(found, "delay") == pytest.approx(probability(found, "amplifier_lag"), rel=1e-9)
    assert 0.4 < probability(found, "delay") < 0.5
    assert verdict(found) == ("ambiguous", ("delay", "amplifier_lag"))


def test_a_parameter_that_is_not_told_from_an_end_of_its_range_costs_no_freedom():
    """Eddy currents of an order of one are a lag by one parameter."""
    table = {"": 5e4, **dict.fromkeys(SINGLES, 5e4), "amplifier_lag": 0.0, "eddy_current": 0.0}
    charged = evidence(table)
    at_end = np.array(["eddy_current" in names for names in charged.effects], int)
    for e, alike in ((charged, False), (replace(charged, at_end=at_end), True)):
        found = entries(e)
        lag, eddy = (probability(found, name) for name in ("amplifier_lag", "eddy_current"))
        assert eddy == pytest.approx(lag) if alike else eddy < 0.5 * lag


def test_while_the_motion_is_small_a_force_law_and_a_stiffness_are_a_class():
    """Neither is preferred for its fewer parameters, which small motion does not show apart; large motion tells."""
    both = {"": 5e4, **dict.fromkeys(SINGLES, 5e4), "negative_stiffness": 0.0, "force_law": 2.0}
    worded, cause = judged(evidence(both))
    assert worded == "ambiguous" and set(cause) == {"negative_stiffness", "force_law"}
    assert judged(evidence(both | {"force_law": 3e3})) == ("explained", ("negative_stiffness",))
    assert judged(evidence(both | {"negative_stiffness": 3e3})) == ("explained", ("force_law",))


def test_a_cost_that_a_form_may_leave_excludes_little_and_one_beyond_it_much():
    """A friction of another form leaves 0.3 % of a large gap and may still be it, a mass may not; nor may a friction
    that leaves a third."""
    friction, mass = (entries(gap(1e5, delay=600.0, **{name: 300.0})) for name in ("friction", "mass"))
    far = entries(gap(1e5, delay=600.0, friction=3e4))
    assert probability(friction, "friction") > 0.05 and probability(mass, "delay") < 0.02
    assert probability(far, "friction") < 0.01


def test_what_a_needless_effect_could_leave_is_no_excuse_for_a_pair():
    """The form of a limited voltage counts by what it saves: beside a mode that explains all but a little, nothing."""
    costs = {"": 1e5, **dict.fromkeys(SINGLES, 1e5), "delay": 400.0}
    found = entries(evidence(costs, pairs={"delay+mass": 0.0, "delay+friction": 398.0}))
    assert probability(found, "delay", "mass") > 10 * probability(found, "delay", "friction")


def test_a_needless_second_effect_is_not_named():
    e = evidence({"": 5e4, **dict.fromkeys(SINGLES, 5e4), "delay": 0.0}, pairs={"delay+friction": -1.0})
    assert judged(e) == ("explained", ("delay",))


def test_a_pair_is_named_where_neither_alone_will_do():
    costs = {"": 8e4, **dict.fromkeys(SINGLES, 8e4), "delay": 3e4, "friction": 4e4}
    found = entries(evidence(costs, pairs={"delay+friction": 0.0}))
    assert verdict(found)[0] == "explained" and set(verdict(found)[1]) == {"delay", "friction"}


def test_a_group_that_stays_unexplained_is_unknown():
    """However much of the whole the best effect explains."""
    before = np.full(len(GROUPS), 5e3)
    left = np.zeros(len(GROUPS))
    costs = {"": before.sum(), **dict.fromkeys(SINGLES, before.sum()), "delay": 4.5e3}
    left[4] = 4.5e3
    found = entries(evidence(costs, excess={"delay": left}))
    assert verdict(found) == ("unexplained", ("unknown",))
    top = next(e for e in found if e.effects == ("delay",))
    assert top.explained_worst_group < 0.2 and top.cost < EXPECTED + 0.1 * before.sum()
    spread = costs | {"delay": before.sum(), "friction": 3e3}  # of another form, as it may be
    assert judged(evidence(spread, excess={"friction": np.full(len(GROUPS), 3e3 / 12)})) == ("explained", ("friction",))


def test_what_nothing_known_touches_is_unknown():
    assert judged(gap(5e4)) == ("unexplained", ("unknown",))


def test_more_evidence_is_never_held_against_an_effect():
    """As its rivals grow worse, its probability grows."""
    found = [probability(entries(gap(size, delay=0.0)), "delay") for size in np.geomspace(3.0, 1e6, 30)]
    assert (np.diff(found) > -1e-9).all() and found[0] < 0.3 and found[-1] > 0.9
    last = [probability(entries(gap(1e4, delay=0.0, mass=left)), "delay") for left in np.linspace(0.0, 1e4, 20)]
    assert (np.diff(last) > -1e-9).all()


def test_the_order_of_candidates_does_not_matter():
    e = gap(3e3, delay=5.0, mass=20.0)
    order = [0, *range(len(SINGLES), 0, -1)]
    turned = replace(e, effects=tuple(e.effects[i] for i in order), cost=e.cost[order], excess=e.excess[order])
    one, other = ({x.effects: x.probability for x in entries(v)} for v in (e, turned))
    assert one == pytest.approx(other, rel=1e-9)
    assert all(turned.effects[x.candidate] == x.effects for x in entries(turned) if x.candidate)


def test_a_nominal_rig_that_touches_down_is_not_believed():
    found = entries(evidence({"": np.inf, **dict.fromkeys(SINGLES, np.inf), "actuator_gain": 0.0}, nominal=np.inf))
    assert verdict(found) == ("explained", ("actuator_gain",))
    assert probability(found, "none") == 0.0 and probability(found, "calibration") == 0.0
    assert all(e.explained_worst_group is None for e in found)  # nothing to compare with


def test_pickup_is_named():
    found = entries(evidence(tones={"pickup": 5e3}))
    assert verdict(found) == ("explained", ("pickup",))
    assert found[0].candidate == 0  # beside calibration


def test_pickup_beside_an_effect_is_a_pair():
    found = entries(replace(gap(5e4, delay=0.0), tones={"pickup": 5e4}))
    assert verdict(found) == ("explained", ("delay", "pickup"))


@pytest.mark.parametrize("tone", ["pickup", "runout"])
def test_no_form_of_an_effect_excuses_a_tone(tone):
    """Another form of the friction might leave ten times what the tone weighs, on lines of the excitation."""
    tones, spin = ({"pickup": 5e3}, {}) if tone == "pickup" else ({"spin": 5e3}, {"runout": 0.0, "unbalance": 4e3})
    loud = replace(gap(1e6, friction=0.0), tones=tones, spin=spin)
    assert allowance(loud) > 10 * 5e3
    assert judged(loud) == ("explained", ("friction", tone))


@pytest.mark.parametrize("tone", ["pickup", "unbalance"])
def test_a_tone_of_known_lines_stands_beside_a_pair(tone):
    """A rotor that turns is out of balance, whatever else is off. A needless second effect is not named for that."""
    costs = {"": 8e4, **dict.fromkeys(SINGLES, 8e4), "delay": 3e4, "friction": 4e4}
    tones = {"pickup": 5e4} if tone == "pickup" else {"spin": 5e4}
    beside = {"tones": tones, "spin": {} if tone == "pickup" else {"runout": 4e4, "unbalance": 0.0}}
    worded, cause = judged(evidence(costs, pairs={"delay+friction": 0.0}, **beside))
    assert worded == "explained" and set(cause) == {"delay", "friction", tone}
    worded, cause = judged(evidence(costs | {"delay": 0.0}, pairs={"delay+friction": -1.0}, **beside))
    assert worded == "explained" and set(cause) == {"delay", tone}


@pytest.mark.parametrize(("spin", "named"), [((0.0, 4e3), "runout"), ((4e3, 0.0), "unbalance")])
def test_what_turns_is_told_by_its_costs(spin, named):
    e = evidence(tones={"spin": 5e3}, spin=dict(zip(("runout", "unbalance"), spin, strict=True)))
    assert judged(e) == ("explained", (named,))


def test_at_one_speed_runout_and_unbalance_are_alike():
    worded, cause = judged(evidence(tones={"spin": 5e3}, spin={"runout": 0.0, "unbalance": 0.0}))
    assert worded == "ambiguous" and set(cause) == {"runout", "unbalance"}


def test_a_foreign_tone_is_unknown():
    assert judged(evidence(tones={"foreign": 5e3})) == ("unexplained", ("unknown",))
    assert judged(replace(gap(3e4, delay=0.0), tones={"foreign": 3e4})) == ("unexplained", ("unknown",))
    assert judged(evidence(tones={"pickup": 5e3, "foreign": 5e3})) == ("unexplained", ("unknown",))


def test_where_the_best_explanation_lacks_something_others_are_less_excluded_and_the_unknown_is_more_likely():
    """Recordings that disagree with the best of two effects take the certainty from its lead over the other."""
    costs = {"": 400.0, **dict.fromkeys(SINGLES, 400.0), "mass": 60.0, "delay": 0.0}
    sure = evidence(costs)
    loose = replace(sure, dispersion=Dispersion(ChiSquare(0.0, 0.0), ChiSquare(60.0, 6.0)))
    before, after = entries(sure), entries(loose)

    def odds(found):
        return probability(found, "delay") / probability(found, "mass")

    assert odds(before) > 1e3 and odds(after) < 30
    assert verdict(before) == ("explained", ("delay",)) and verdict(after) == ("unexplained", ("unknown",))
    excused = replace(sure, dispersion=Dispersion(ChiSquare(0.0, 0.0), ChiSquare(20.0, 6.0)))  # as noise may make it
    assert entries(excused) == before


def test_tones_of_one_foreign_vibration_are_named_and_others_unknown():
    tones = {"foreign": 400.0, "loud": 60.0}
    one = evidence(tones=tones)
    assert judged(one) == ("unexplained", ("unknown",))
    shaken = {"foreign": {"foreign_vibration": 3.0}, "loud": {"foreign_vibration": 0.0}}
    assert judged(replace(one, causes=shaken)) == ("explained", ("foreign_vibration",))
    elsewhere = {"foreign": {"foreign_vibration": 3.0}, "loud": {"foreign_vibration": 60.0}}
    assert judged(replace(one, tones={**tones, "loud": 4e3}, causes=elsewhere))[1] != ("foreign_vibration",)
    both = replace(gap(5e4, delay=0.0), tones=tones, causes=shaken)
    assert set(judged(both)[1]) == {"delay", "foreign_vibration"}


def test_a_gain_that_drifts_is_another_one_in_the_mean_too():
    """It is named once, and not beside the actuator gain."""
    off = {"": 4e3, **dict.fromkeys(SINGLES, 4e3), "actuator_gain": 0.0}
    drifts = replace(evidence(off), tones={"drift": 500.0}, causes={"drift": {"gain_drift": 2.0}})
    assert judged(drifts) == ("explained", ("gain_drift",))
    within = replace(evidence(), tones={"drift": 500.0}, causes={"drift": {"gain_drift": 2.0}})
    assert judged(within) == ("explained", ("gain_drift",))
    otherwise = replace(evidence(), tones={"drift": 500.0}, causes={"drift": {"gain_drift": 450.0}})
    assert judged(otherwise) == ("unexplained", ("unknown",))


def test_samples_that_are_dropped_are_loud_and_a_delay_is_not():
    """In the mean both are the same; what scatters decides."""
    costs = {"": 3e3, **dict.fromkeys(SINGLES, 3e3), "delay": 0.0, "dropped_samples": 0.0}
    quiet = evidence(costs)
    assert set(judged(quiet)[1]) == {"delay", "dropped_samples"}
    assert judged(replace(quiet, tones={"loud": 500.0})) == ("explained", ("dropped_samples",))
    none_lost = {"loud": {"dropped_samples": 500.0}}  # each command is told, and none is lost by itself
    assert judged(replace(quiet, tones={"loud": 500.0}, causes=none_lost))[0] == "unexplained"


LAGGING = replace(load_rig("hmb_free"), amplifier_time_constant=1e-4, sensor_time_constant=5e-5)


def idle(effects, changes=MappingProxyType({})):
    return idle_cost(Point(effects, changes), tuple(effects), LAGGING)


def test_an_effect_that_changes_nothing_costs_what_a_clear_gap_is_worth():
    assert idle({"sensor_lag": {"time_constant": 0.0}}, {"sensor_time_constant": -0.9}) == IDLE
    assert idle({"force_law": {"exponent": 0.4, "offset": 0.0}}) == 0.0
    assert idle({}) == 0.0


def test_an_effect_that_changes_nothing_is_not_named_beside_another_one():
    """A saturation beside an amplifier that is faster than stated: nothing lags."""
    saturated, lag = {"saturation": {"field": 1.0}}, {"amplifier_lag": {"time_constant": 0.0}}
    assert idle(saturated | lag, {"amplifier_time_constant": -0.07}) == inf
    assert idle(saturated | lag, {"amplifier_time_constant": 0.07}) == 0.0
    assert idle({"sensor_lag": {"time_constant": 1e-5}, "damping": {"coefficient": 0.0}}) == inf


@pytest.mark.parametrize(("knee", "cost"), [({"current": 1.0}, 0.0), ({"command": 1.0}, 0.0), ({}, inf)])
def test_iron_that_saturates_at_a_current_is_named_beside_another_effect(knee, cost):
    """As of a single magnet, whose fields are not known."""
    assert idle({"delay": {"time": 1e-4}, "saturation": {"sharpness": 3.0} | knee}) == cost


def test_what_a_stated_constant_explains_better_than_any_name_is_unknown():
    """A saturation leaves no more than another form of it may; beside it, an amplifier that is faster than stated
    leaves nothing, which no form of a saturation does."""
    saturated = gap(1e5, saturation=1e3)
    assert judged(saturated) == ("explained", ("saturation",))
    assert judged(replace(saturated, nameless=EXPECTED)) == ("unexplained", ("unknown",))
    # A little better is what any further constant is.
    assert judged(replace(saturated, nameless=EXPECTED + 1e3 - 20.0)) == ("explained", ("saturation",))


def test_what_one_effect_explains_where_it_has_no_meaning_is_an_unknown_cause_rather_than_two_known_ones():
    """As a spring that creeps passes for friction that never slides, which damping beside a lag in the iron does as
    well; here a saturation has no meaning."""
    every = {"": 1e4, **dict.fromkeys(SINGLES, 1e4), "saturation": inf}
    both = evidence({**every, "mass": 3e3}, pairs={"mass+friction": 0.0})
    assert judged(both) == ("explained", ("mass", "friction"))
    refused = np.full(both.cost.size, inf)
    refused[both.effects.index(("saturation",))] = EXPECTED
    assert judged(replace(both, refused=refused)) == ("unexplained", ("unknown",))
    assert judged(replace(both, refused=refused + 500.0)) == ("explained", ("mass", "friction"))
    # A name that does as well alone is the cause, or no cause is needed.
    named = evidence({**every, "mass": 5.0}, pairs={"mass+friction": 0.0})
    assert judged(replace(named, refused=refused)) == ("explained", ("mass",))
    nothing = evidence({"saturation": inf}, pairs={"mass+friction": 0.0})
    assert judged(replace(nothing, refused=refused)) == ("no_gap", ())


def test_a_form_without_meaning_is_no_cause_of_what_calibration_leaves_as_noise():
    """A mode that is damped so strongly that it has no resonance, near the ends of two of its ranges, follows noise."""
    nothing = evidence({"sensor_resonance": inf}, pairs={"sensor_resonance+support_resonance": -36.0})
    at = nothing.effects.index(("sensor_resonance",))
    refused, ends = np.full(nothing.cost.size, inf), np.zeros(nothing.cost.size)
    refused[at], ends[at] = nothing.cost[0] - 42.0, 1.8
    meaningless = replace(nothing, refused=refused, at_end=ends)
    assert judged(replace(meaningless, excess=nothing.excess + 4.0)) == ("unexplained", ("unknown",))
    assert judged(replace(meaningless, excess=nothing.excess - 4.0)) == ("no_gap", ())


def test_a_block_whose_stated_time_constant_grew_lags():
    lag = {"amplifier_lag": {"time_constant": 0.0}}
    assert idle(lag, {"amplifier_time_constant": 0.56}) == 0.0
    assert idle(lag, {"amplifier_time_constant": 0.0}) == IDLE
    assert idle(lag, {"sensor_time_constant": 0.56}) == IDLE
    # Part of a lag may be simulated as a delay, which is no effect of its own.
    form = Point(lag | {"delay": {"time": 0.0}}, {"amplifier_time_constant": 0.56})
    assert idle_cost(form, ("amplifier_lag",), LAGGING) == 0.0


def test_a_lag_that_is_taken_off_the_stated_time_constant_makes_nothing_later():
    lag = {"amplifier_lag": {"time_constant": 2e-5}}
    assert idle(lag, {"amplifier_time_constant": -0.2}) == IDLE
    assert idle(lag, {"amplifier_time_constant": -0.1}) == 0.0
    dead = Point(lag | {"delay": {"time": 2e-5}}, {"amplifier_time_constant": -0.2})
    assert idle_cost(dead, ("amplifier_lag",), LAGGING) == 0.0
    assert idle_cost(dead, ("amplifier_lag", "delay"), LAGGING) == inf
    assert idle({"sensor_lag": {"time_constant": 2e-5}}, {"sensor_time_constant": -0.4}) == IDLE


def test_what_a_rig_states_weighs_its_full_weight_beside_a_large_gap():
    """Three tolerances and more are not excused by what another form of an effect may leave of a gap of a million."""
    costs = {"": 1e6, **dict.fromkeys(SINGLES, 1e6), "mass": 0.0, "mass+delay": 0.0}
    free = evidence(costs)
    assert judged(free) == ("explained", ("mass",))
    strain = np.where([names == ("mass",) for names in free.effects], 32.0, 0.0)
    cost = free.cost + strain
    assert judged(replace(free, cost=cost)) == ("explained", ("mass",))
    assert judged(replace(free, cost=cost, strain=strain)) == ("explained", ("mass", "delay"))


@pytest.mark.parametrize("left", [0.0, 4e3])
def test_what_is_out_of_reach_of_the_best_is_hopeless(left):
    """With and without something that the best explanation lacks, which divides all differences."""
    lacks = Dispersion(ChiSquare(EXPECTED + left, EXPECTED), ChiSquare(0.0, 0.0))
    e = replace(gap(1e5, delay=0.0), dispersion=lacks)
    far = reach(e)[e.effects.index(("mass",))]
    at, half = (entries(replace(gap(1e5, delay=0.0, mass=share * far), dispersion=lacks)) for share in (1.0, 0.3))
    ratios = [probability(found, "delay") / probability(found, "mass") for found in (at, half)]
    assert ratios[0] >= 0.99 * HOPELESS > ratios[1]


def test_what_only_a_wrong_statement_of_the_rig_explains_is_unknown_beside_poor_explanations():
    """Saturation would explain all, with a mass that is off by many tolerances; a delay leaves most of the gap. So it
    can be explained, but by nothing that is known. Where an effect explains it as well without, that is named."""

    def strained(found, name, by):
        strain = np.where([names == (name,) for names in found.effects], by, 0.0)
        return replace(found, cost=found.cost + strain, strain=strain)

    poor = gap(2e4, saturation=0.0, delay=1.7e4)
    assert judged(strained(poor, "saturation", 200.0)) == ("unexplained", ("unknown",))
    assert judged(strained(poor, "saturation", 6.0)) == ("explained", ("saturation",))
    assert judged(strained(gap(2e4, saturation=0.0, delay=1.0), "saturation", 200.0)) == ("explained", ("delay",))
    by_calibration = replace(gap(0.0, delay=-2.0), strain=None)
    strain = np.where([not names for names in by_calibration.effects], 85.0, 0.0)
    strained_rig = replace(by_calibration, cost=by_calibration.cost + strain, strain=strain)
    assert judged(strained_rig)[1] != ("unknown",)


def test_a_drift_that_was_fitted_leaves_of_the_trends_what_a_drift_may():
    """A delay needs the drift beside it; a fitted drift explains the trends itself, and is named once."""
    both = evidence({"": 500.0, **dict.fromkeys(SINGLES, 500.0), "delay": 0.0}, tones={"drift": 200.0})
    caused = replace(both, causes={"drift": {"gain_drift": 0.0}})
    assert judged(caused) == ("explained", ("delay", "gain_drift"))
    fitted = evidence({"": 500.0, **dict.fromkeys(SINGLES, 500.0), "gain_drift": 0.0}, tones={"drift": 200.0})
    assert judged(replace(fitted, causes={"drift": {"gain_drift": 2.0}})) == ("explained", ("gain_drift",))
    assert judged(replace(fitted, causes={"drift": {"gain_drift": 150.0}})) == ("unexplained", ("unknown",))
