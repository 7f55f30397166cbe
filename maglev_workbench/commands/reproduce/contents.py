"""Every table and figure of the dissertation, with what became of it here."""

from dataclasses import dataclass
from typing import Literal

State = Literal["reproduced", "contradicted", "not reproducible"]
STATES: tuple[State, ...] = ("reproduced", "contradicted", "not reproducible")


@dataclass(frozen=True)
class Entry:
    """A table or figure.

    Args:
        label: "Figure 3.20", "Table 5.2".
        shows: what it shows.
        state: "contradicted": its main statement differs from ours, or from another of the text.
        item: experiment that does it; "" for none.
        why: why it is contradicted, or cannot be reproduced, or what its reproduction is worth.
    """

    label: str
    shows: str
    state: State
    item: str = ""
    why: str = ""


_WHY = {
    "p": "photograph or drawing: no result",
    "d": "diagram or scheme: no result; what it describes is modelled",
    "m": "diagram: no result; not modelled",
    "n": "definitions or given values: inputs, used as printed",
}
# label | what it shows | p, d, m, n (not reproducible, see _WHY), r:item or r:item:why, c:item:why, or x:why (not
# reproducible)
_LINES = """
Figure 1.1|control loop of a magnetic bearing|d
Figure 2.1|Berlin Heart Incor|p
Figure 2.2|Streamliner pump|p
Figure 2.3|TMDU/TIT pump|p
Figure 2.4|HeartMate III|p
Figure 3.1|section of the pump|p
Figure 3.2|straightener, impeller, diffuser and rotor|p
Figure 3.3|main dimensions of the pump|p
Figure 3.4|pump casing|p
Figure 3.5|straightener|p
Figure 3.6|velocity triangles of the impeller|r:hydraulics:from the printed angles
Figure 3.7|blade geometry of the impeller|p
Figure 3.8|assembled velocity diagram|r:hydraulics:from the printed angles
Figure 3.9|cited for the trigonometry|x:cited, but not in the text
Figure 3.10|velocity triangles of the diffuser|x:the diffuser's angles and pressure recovery are not given
Figure 3.11|blade geometry of the diffuser|p
Table 3.1|blade angles, speed and pressure|r:hydraulics:from the printed angles; the axial velocity needs an \
inferred factor
Figure 3.12|machined impeller, diffuser and straightener|p
Figure 3.13|straightener, exploded|p
Figure 3.14|impeller, assembled|p
Figure 3.15|impeller, in parts|p
Figure 3.16|diffuser, exploded|p
Figure 3.17|5-axis machining|p
Figure 3.18|machining program|p
Figure 3.19|flux paths of the bearing|d
Figure 3.20|2D model for the finite-element program|x:the outline and the materials are in the figure only
Figure 3.21|map of the magnetic flux in the pump|x:needs the outline of Figure 3.20
Figure 3.22|map of the flux loop of a bearing|x:the outline is in the figure only; flux-map has the map of a bearing \
like it
Figure 3.23|dimensions of the bearing|r:bearing-coefficients:from the text's own relations
Figure 3.24|stator with probe holder|p
Figure 3.25|stator|p
Figure 3.26|lamination fixture|p
Figure 3.27|materials and dimensions of the rotor|p
Figure 3.28|inner sleeve|p
Figure 3.29|rotor and its assembly|p
Figure 3.30|wiring of the motor|d
Table 3.2|symbols of the motor|n
Figure 3.31|fixture of the motor's coils|p
Figure 3.32|the same, made|p
Figure 3.33|coil winding|p
Figure 3.34|motor stator|p
Figure 3.35|3D model of the bearing|p
Table 3.3|computed forces under axial displacement|c:axial-force:-0.13 N where symmetry has none, a radial force 12 % \
below eq 3.9, and an axial stiffness 2.8 times Table 5.4's
Figure 3.36|radial force over axial displacement|c:axial-force:its level, as Table 3.3; that it hardly varies agrees
Figure 3.37|axial force over axial displacement|c:axial-force:as Table 3.3
Figure 3.38|magnets above and below the rotor|d
Figure 3.39|magnetic circuit|c:bearing-coefficients:the control flux closes through the gaps, not through the magnet
Table 3.4|values of the bearing|n
Figure 3.40|loop of one radial direction|d
Table 3.5|gains of the controller|c:stability-conditions:they levitate, but not by the conditions of eq 3.26, which \
pass gains that cannot hold the rotor
Figure 3.41|displacements at rest|r:levitation:radially; noise of the axial probe is not simulated
Figure 3.42|displacements at 14,000 rpm|c:levitation:ours is damped far better and turns on larger orbits at that speed
Figure 3.43|displacements over speed|c:run-up:the peak agrees, the fall behind it and the axial displacement do not
Figure 3.44|coil current over speed|x:its values are in the figure only; ours are in coil-current
Table of section 3.5|power of motor and bearings|c:coil-current:copper explains 5 % of the bearings' power
Figure 4.1|loop of the platform|d
Figure 4.2|steps of parameter estimation|d
Figure 4.3|one-axis rig|p
Table 4.1|dimensions of the E-frame|n
Figure 4.4|instruments of the rig|d
Figure 4.5|rig|p
Figure 4.6|SPHS and averaging over five periods|r:averaging:the curves are in the figure only; five periods \
are found adequate, as the text says
Figure 4.7|effective and actual coefficients|c:effective-actual:the directions agree; eq 4.7 is not flat with our \
gains, as its own are not published
Figure 4.8|statistics of the estimates|c:effective-actual:fits of 0.988 to 0.996 do not go with 100 mV of noise
Figure 4.9|influence of K_p|c:gain-influence:the response at resonance and the damping at low frequency go the other way
Figure 4.10|influence of K_i|r:gain-influence
Figure 4.11|the same near the mode|r:gain-influence
Figure 4.12|influence of K_d|r:gain-influence
Figure 5.1|one-axis model|d
Figure 5.2|model with eight coefficients|d
Figure 5.3|model with direct coefficients|d
Figure 5.4|steps of estimation in two axes|d
Figure 5.5|rig of the bearings|p
Figure 5.6|scheme of the rig|d
Figure 5.7|force and displacement of the pedestal over time|x:its values are in the figure only; pedestal simulates it
Table 5.1|stiffness of the springs|r:pedestal:the rig is built from it: what is tested is the estimator
Table 5.2|the same in four bands|c:pedestal-damping:no cause tried lowers the fit and the stiffness as the band widens
Figure 5.8|transfer function of the pedestal|r:pedestal:its peak, of a rig built from Table 5.1
Figure 5.9|rig for the actuator gain|p
Figure 5.10|open loop for the actuator gain|d
Figure 5.11|actuator gain over frequency|c:actuator-gain:flat to 50 Hz; a mode at 270 Hz makes 16 % at 100 Hz of \
what is said to vary little
Figure 5.12|the same up to 50 Hz|r:actuator-gain:flat as published; its height is built in
Figure 5.13|force over voltage at the centre|r:actuator-gain:linear as published; its slope is built in
Figure 5.14|gain over eccentricity|c:actuator-gain:every force law rises with eccentricity; the published gain falls
Figure 5.15|axes, force and probes|d
Table 5.3|eight coefficients|c:eight-coefficients:one excitation tells row sums only, and these do not fit mass and mode
Figure 5.16|transfer functions and fit in x and y|c:appendix-c:the fit above 40 Hz agrees, below it ours falls less
Figure 5.17|stiffnesses by eight coefficients|c:appendix-c:the program makes m w^2 of any stiffness
Figure 5.18|dampings by eight coefficients|c:appendix-c:small and insignificant as published, but as wide as the noise \
makes them
Figure 5.19|force and its components|d
Figure 5.20|direct coefficients|c:stiffness-causes:no loop with these gains is so stiff; what made the rise is open
Figure 5.21|both models compared|c:appendix-c:the noise that gives one curve does not give the other
Figure 5.22|influence of k_p|c:proportional-gain:the mode rises as published, the stiffness at rest has the other sign
Figure 5.23|at rest and at 8,000 rpm|c:spinning:unbalance and runout show around 133 Hz
Figure 5.24|axial rig|p
Figure 5.25|its scheme|d
Figure 5.26|its model|d
Table 5.4|axial estimate at 18-28 Hz|r:axial:the rig is built from it; its fit of 0.984 is not ours
Figure 5.27|axial estimates over frequency|c:stiffness-causes:the rise is that of m w^2; what made it is open
Figure 5.28|axial and radial compared|c:axial:of the damping as published; the ratio of stiffnesses is one of limits
Figure 6.1|flux path|d
Figure 6.2|coil model in Simulink|d
Figure 6.3|switching voltage|d
Figure 6.4|high-pass|r:digital-filters:designed to the printed corner
Figure 6.5|rectifier|d
Figure 6.6|low-pass|r:digital-filters:designed to the printed corner
Figure 6.7|flowchart of demodulation|d
Figure 6.8|the same in Simulink|d
Figure 6.9|demodulation at constant duty|r:forward-path:in words, as published; no figures are
Figure 6.10|demodulation at varying duty|c:forward-path:eq 6.25 moves the duty too little; edges on samples corrupt it
Figure 6.11|the same, enlarged|c:forward-path:as Figure 6.10
Figure 6.12|scheme of the estimator|d
Figure 6.13|estimator and demodulation|r:estimator-tracking
Figure 6.14|frequency response of the estimator|r:estimator-response:its gains are chosen to give the 18 degrees
Figure 6.15|structure of the circuit|d
Figure 6.16|current sensor|p
Figure 6.17|sensed coil current|c:laminations:eddy currents in the laminations make no step that the sensor would \
show as vertical
Figure 6.18|band-pass circuit|c:band-pass:centre, width and gain do not have the published edges
Figure 6.19|current behind the band-pass|r:band-pass
Figure 6.20|rms converter|x:its part values are in the figure only; its averaging is assumed in band-pass
Figure 6.21|PI circuit|m
Figure 6.22|switching voltage, measured|x:an oscillogram without figures; the simulation takes ideal edges
Figure 6.23|balanced modulator|m
Figure 6.24|board and backplane|m
Figure 6.25|boards|p
Figure 6.26|rig of the self-sensing|p
Figure 6.27|static calibration|p
Table 6.1|output over displacement|r:static-calibration:its line anew, which is better than published; the \
simulated estimator is linear, too
Figure 6.28|its line|c:static-calibration:the published line counts the first saturated point
Figure 6.29|instruments of the dynamic calibration|d
Figure 6.30|probe and self-sensing over time|c:dynamic-calibration:a minimal delay does not go with 30° at 150 Hz
Figure 6.31|frequency response of the self-sensing|c:dynamic-calibration:neither 30° at 150 Hz nor the dip is the \
estimator's
Figure 6.32|phase margin of the circuit|c:estimator-response:83° of margin and 18° at 4 kHz are not one design
Figure B.1|straightener, drawing|p
Figure B.2|impeller, drawing|p
Figure B.3|diffuser, drawing|p
Figure E.1|two-state amplifier, wiring|m
Figure E.2|three-state amplifiers, wiring|m
"""


def _entry(line: str) -> Entry:
    label, shows, code = line.split("|")
    kind, _, rest = code.partition(":")
    if kind in _WHY:
        return Entry(label, shows, "not reproducible", why=_WHY[kind])
    if kind == "x":
        return Entry(label, shows, "not reproducible", why=rest)
    item, _, why = rest.partition(":")
    return Entry(label, shows, "reproduced" if kind == "r" else "contradicted", item, why)


CONTENTS: tuple[Entry, ...] = tuple(map(_entry, _LINES.strip().splitlines()))


def contents_rows() -> list[tuple[str, ...]]:
    """Cells of all entries: label, what it shows, state, experiment, reason."""
    return [(e.label, e.shows, e.state, e.item, e.why) for e in CONTENTS]


def contents_summary() -> str:
    """How many of the tables and figures have which state."""
    counts = ", ".join(f"{sum(e.state == state for e in CONTENTS)} {state}" for state in STATES)
    pictures = sum(e.why in _WHY.values() for e in CONTENTS)
    return f"{len(CONTENTS)} tables and figures: {counts} ({pictures} of these show no result)."
