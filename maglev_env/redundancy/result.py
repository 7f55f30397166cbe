"""What an identification cannot be: a peak below 1, constants where none fit, margins of what is contradicted."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

from maglev_env.evaluation.identification import Identification
from maglev_env.evaluation.stability import ASSUMED
from maglev_env.redundancy.finding import Finding

NOMINAL = ("gains", "actuator gain")  # what margins without an injection take from the campaign and its rig
POOR_P, POOR_R2, MOST_POOR = 1e-3, 0.9, 0.5  # of a band; share of the bands that may be poor


def doubtful(recording: str, found: Identification) -> list[Finding]:
    """Findings of one axis of a recording that is identified already; `rules` has looked at its channels before.

    Under the null hypothesis fit_p is uniform, so chance makes a band poor once in a thousand, and half of them never.
    """
    findings = []
    known = [band for band in found.bands if band.informative and not band.ls_biased]
    poor = [band for band in known if band.fit_p < POOR_P and band.r2_adjusted < POOR_R2]
    if len(poor) > MOST_POOR * len(known):
        share = len(poor) / len(known)
        text = (
            f"stiffness and damping: constants do not fit {len(poor)} of {len(known)} bands (fit_p below {POOR_P:g}): "
            "a resonance, a nonlinearity or another effect (run `maglev diagnose`), the mass is not the stated one, or "
            "force and displacement were not read by one clock"
        )
        findings.append(Finding("fit", recording, "mass", share, None, text, "effect"))
    if found.stability is not None:
        peak = found.stability.margins.peak_sensitivity
        ends = found.stability.margins.intervals.get("peak_sensitivity", (None, None))
        if (ends[1] if ends[1] is not None else peak) < 1:
            text = (
                f"margins: the peak of |S| is {peak:.3g} in the excited band, below the 1 that every loop reaches; it "
                "lies outside of the band, so peak and ISO zone are too good: excite at higher frequencies"
            )
            findings.append(Finding("sensitivity", recording, "margins", float(peak), None, text, "quality"))
    return findings


def without_contradicted_margins(
    recording: str, found: Identification, warnings: Iterable[Mapping[str, Any]]
) -> Identification:
    """An axis of a recording without the margins that rest on a controller or an actuator which it contradicts.

    Args:
        recording: File, with its axis where it has two.
        found: What is identified of it.
        warnings: Findings of the campaign as data, see `as_data`.
    """
    if found.stability is None or found.stability.source == "injection":
        return found
    for one in warnings:
        wrong = [name for name in NOMINAL if name in one["channel"].split(" or ")]
        if wrong and one["recording"] == recording and one["kind"] not in ("quality", "not checkable"):
            why = (
                f"no margins: they would follow from the stated {' and '.join(wrong)}, which the recording contradicts "
                "(see the warning); correct what is stated, or inject a known signal at the command"
            )
            kept = [note for note in found.notes if not note.startswith(ASSUMED)]
            return replace(found, stability=None, notes=(*kept, why))
    return found
