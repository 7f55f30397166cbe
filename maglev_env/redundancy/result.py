"""What an identification cannot be: a peak sensitivity below 1, or constants where constants do not fit."""

from maglev_env.evaluation.identification import Identification
from maglev_env.redundancy.finding import Finding

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
