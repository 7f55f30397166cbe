"""What the names of columns mean: words and abbreviations of English, German, Spanish and French laboratories."""

import re
import unicodedata
from dataclasses import dataclass

# A word that stands for a quantity. Single letters and their like are listed apart, because they say less.
_WORDS = {
    "time": "time zeit tiempo temps tempo timestamp clock seconds sekunden segundos elapsed",
    "displacement": "position pos displacement displ disp gap airgap weg auslenkung spalt luftspalt posicion lage "
    "desplazamiento entrehierro distance distancia abstand hoehe height altura deplacement entrefer wirbelstrom kugel "
    "posizione spostamento traferro distanza altezza",
    "current": "current curr cur strom corriente corrente courant amps ampere spulenstrom icoil",
    "voltage": "voltage volt volts spannung voltaje tension tensione spulenspannung",
    "force": "force kraft fuerza forza loadcell shaker kraftsensor kraftmessdose hammer dynamometer",
    "velocity": "velocity vel geschwindigkeit velocidad vitesse ydot xdot zdot derivative ableitung",
    "speed": "rpm omega drehzahl speed revs rotation giro",
    "acceleration": "acceleration accel acc beschleunigung beschl aceleracion accelerazione accelerometer",
    "error": "error err fehler regelabweichung abweichung deviation",
    "count": "index idx sample samples nr number count zaehler muestra",
    "temperature": "temp temperature temperatur temperatura",
    "output": "output pwm duty stellgroesse stell stellsignal controller ctrl regler reglerausgang control salida "
    "mando commande",
}
_LETTERS = {
    "time": "t ts",
    "displacement": "y x z h yl xl",
    "current": "i",
    "voltage": "uc ucoil",
    "force": "f",
    "velocity": "v dy dx dz vy vx",
    "acceleration": "ay ax",
    "error": "e",
    "count": "n k",
    "output": "u",
}
# The SI units that a single letter goes with, "V" being a transducer's for all of them: a "V13" in um is no velocity.
_IN = {
    "time": ("s",),
    "displacement": ("m", "V", "A", "N"),  # "coil_x" in A is along x
    "current": ("A", "V"),
    "voltage": ("V",),
    "force": ("N", "V"),
    "velocity": ("m/s", "V"),
    "acceleration": ("m/s2", "V"),
    "error": ("m", "V"),
    "count": ("",),
}
# What a unit alone says.
_BY_UNIT = {
    "m": "displacement",
    "N": "force",
    "s": "time",
    "rad/s": "speed",
    "m/s": "velocity",
    "m/s2": "acceleration",
}
# What any quantity may be read by, so that it tells one only where no other word does: "i_probe" is a current clamp.
# So is "dist", which may stand for a disturbance.
_INSTRUMENTS = {
    "displacement": "probe hall sensor sens lvdt laser photodiode dist encoder codeur encodeur drehgeber codificador"
}
_WANTED = (
    "ref reference setpoint sp soll sollwert set desired des wanted target yd command cmd demand "
    "referencia riferimento comando desejada desejado desiderata desiderato consigna consigne vorgabe "
    "fuehrungsgroesse kommando w r"
)
_DISTANCES = "gap airgap spalt luftspalt entrehierro entrefer traferro distanza distance dist distancia abstand"
_ESTIMATED = "hat obs observer est estimate estimated estimado schaetz schaetzwert geschaetzt observador"
_INJECTED = (
    "inj injection injected injektion dither exc excitation anregung stoer stoerung stoergroesse disturbance "
    "perturbation noise rauschen chirp sweep multisine prbs testsignal excitacion eccitazione disturbo rumore"
)
# Words too short to be looked for inside longer ones, where what stands behind them is a quantity: "setcurrent".
_SHORT = re.compile("^(ref|set|des|cmd|act|meas|ist)(?=[a-z]{3})")
# A letter with a word or an axis: "iref", "iy"; v and w are axes of bearings, too.
_GLUED = re.compile("^([iyxzhufvw])(ref|soll|cmd|set|des|obs|hat|est|meas|mess|ist|act|inj)$|^([iuf])([xyz])$")
_AXES = ("x", "y", "z")
_PLACEHOLDER = re.compile(r"(c|col|column|columna|spalte|kanal|channel|ch|var|unnamed:?|data|values?)?[_ ]?\d*")
COUNTS = "count counts cts ticks raw digits bits lsb"  # of a converter: a unit, where other words stand beside
_WITHOUT_MEANING = {"data", "value", "values", "signals", "signal", "out", "in", "model", "root", "y1", "mess", "meas"}


@dataclass(frozen=True)
class Meaning:
    """What a name says.

    Args:
        channel: the channel of a campaign; a quantity that is none ("velocity", "error", ...); None: says nothing.
        axis: "x", "y" or "z" where a letter stands beside the quantity; else empty.
        confidence: from 0 to 1.
        word: what in the name says so.
    """

    channel: str | None
    axis: str = ""
    confidence: float = 0.0
    word: str = ""


def unaccented(name: str) -> str:
    """A name without accents, its umlauts written out."""
    name = re.sub("[äÄ]", "ae", re.sub("[öÖ]", "oe", re.sub("[üÜ]", "ue", name.replace("ß", "ss"))))
    return unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode()


def plain_words(name: str) -> list[str]:
    """The words of a name in small letters: without accents, split at signs, digits and changes to capitals."""
    name = re.sub(r"([a-z])([A-Z])", r"\1 \2", unaccented(name))
    split = [w.removeprefix("lager") for w in re.split(r"[^a-z]+", name.lower())]  # the bearing's, not "Lage"
    words = " ".join(_GLUED.sub(r"\1\3 \2\4", _apart(w)) for w in split).split()
    return " ".join(words).replace("load cell", "loadcell").split()


def _apart(word: str) -> str:
    """A word with a blank between a short word for "wanted" or "measured" and the quantity that it is glued to."""
    short = _SHORT.match(word)
    behind = word[short.end() :] if short else ""
    return f"{short[1]} {behind}" if short and any(behind in listed.split() for listed in _WORDS.values()) else word


def is_distance(name: str) -> bool:
    """Whether the name of a position says that it is a gap or a distance, which grows away from the magnet."""
    return bool(_one_of(plain_words(name), _DISTANCES, True))


def _one_of(words: list[str], listed: str, compound: bool = False) -> str:
    """The first of the words that is listed, or with `compound` is put together with a listed one: "sollstrom"."""
    known = listed.split()
    if found := next((w for w in words if w in known), ""):
        return found
    long = tuple(k for k in known if len(k) >= 4)
    return next((w for w in words if compound and long and (w.startswith(long) or w.endswith(long))), "")


def meaning(name: str, si: str = "") -> Meaning:
    """What the name of a column means.

    Args:
        name: without its unit.
        si: SI unit that the header states, which settles what the name leaves open.

    Returns:
        The channel with the confidence in it.
    """
    words = [w for w in plain_words(name) if w not in _WITHOUT_MEANING]
    words = [w for w in words if w not in COUNTS.split()] or words
    if not words or _PLACEHOLDER.fullmatch(name.strip().lower()):
        words = []
    quantity, word, sure = _quantity(words, name, si)
    wanted, injected = _one_of(words, _WANTED, True), _one_of(words, _INJECTED, True)
    if "dist" in words and si in ("A", "N"):
        injected = "dist"
    if not quantity and "test" in words:  # "test signal"
        injected = injected or "test"
    if quantity == "current":  # the current that a controller puts out is the one that it asks for
        wanted = wanted or _one_of(words, _WORDS["output"], True)
    if quantity == "velocity" and word == "v" and wanted and not si:
        quantity, word = "", ""  # no bearing is asked for a velocity
    if injected and quantity == "displacement" and word in (*_AXES, injected):
        quantity, word = "", ""  # of "inj_x" the letter is the axis alone
    # Beside other words, as in "ref x" or "probe x", the letter is quantity and axis in one.
    axis = next((w for w in words if w in _AXES and (w != word or len(words) > 1)), "")
    estimated = _one_of(words, _ESTIMATED)
    if si == "A" and quantity in ("", "output", "displacement", "voltage") and not injected:
        quantity, wanted = "current", wanted or (word if quantity == "output" else "")
    if si == "V" and quantity in ("", "output", "velocity") and not injected:
        # The volts of a probe, and a set point that is compared with them, are no voltage at the coil.
        instrument = _one_of(words, _INSTRUMENTS["displacement"])
        if instrument:
            quantity, word = "displacement", instrument
        elif quantity or not wanted:
            quantity, wanted, estimated = "voltage", "", ""
    if not quantity and not injected and si:
        quantity = _BY_UNIT.get(si, "")
        word, sure = f"[{si}]", 0.6 if not wanted else 0.85
    said = word or wanted or injected
    if not said:
        return Meaning(None)
    if quantity in ("", "current", "output", "force") and injected:
        known = {"N": "force", "m": "reference", "A": "injection"}
        channel = known.get(si, "force" if quantity == "force" else "injection")
        return Meaning(channel, axis, 0.85, injected)
    if estimated and quantity in ("displacement", ""):
        return Meaning("gap_estimate", axis, 0.7, estimated)
    if estimated and quantity != "velocity":
        return Meaning("estimate", axis, 0.7, estimated)
    channel = {
        ("displacement", True): "reference",
        ("current", True): "command",
        ("output", True): "command",
        ("output", False): "command",
        ("", True): "command" if wanted in ("command", "cmd", "kommando") else "reference",
    }.get((quantity, bool(wanted)), quantity)
    return Meaning(channel, axis, max(sure, 0.85 if len(wanted) > 1 else 0.6 if wanted else 0.0), said)


def _quantity(words: list[str], name: str, si: str) -> tuple[str, str, float]:
    """The quantity that the words state, the word, and the confidence in it; no single letter against its unit."""
    tables = (_WORDS, 0.95, False), (_LETTERS, 0.75, False), (_WORDS, 0.85, True), (_INSTRUMENTS, 0.75, False)
    for table, sure, compound in tables:
        for w in words:
            for quantity, listed in table.items():
                if table is _LETTERS and si and si not in _IN.get(quantity, si):
                    continue
                if _one_of([w], listed, compound):
                    # The states x1, x2, x3 of a model: only the first is known to be a position.
                    if w == "x" and re.search(r"x_?[2-9]$", name.lower()):
                        return "", "", 0.0
                    return quantity, w, sure
    return "", "", 0.0
