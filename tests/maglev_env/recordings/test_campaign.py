import tomllib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from maglev_env.loop.gains import Gains, LinearController
from maglev_env.recordings.campaign import ChannelSource, load_campaign
from maglev_env.recordings.campaign_writer import toml_value
from maglev_env.recordings.files import write_npz
from maglev_env.rig.excitation import Excitation
from maglev_env.rig.rig_file import load_rig

TOML = """schema = "maglev-campaign/1"
rig = "hmb_free"

[parameters]
mass = 0.0801

[[recording]]
file = "run1.npz"
role = "fit"
sample_rate = 20000.0
start = 0
speed_rpm = 0.0
gains = { kp = 8000.0, ki = 2000.0, kd = 5.2, td = 1e-4, ti = 0.0318 }
excitation = { kind = "sphs", at = "force", fundamental = 1.0, harmonics = [1, 250], amplitude = 3.0, periods = 6 }

[recording.channels]
force        = { from = "F", scale = 10.0 }
displacement = { from = ["y_left", "y_right"], weights = [0.5, 0.5], scale = 1.25e-4 }
command      = { from = "u" }
current      = { from = "i" }
"""
EXCITATION = next(line for line in TOML.splitlines() if line.startswith("excitation"))
GAINS = next(line for line in TOML.splitlines() if line.startswith("gains"))


def campaign(folder: Path, text: str = TOML) -> Path:
    write_npz(folder / "run1.npz", {"F": np.ones(2)})
    (folder / "campaign.toml").write_text(text, encoding="utf-8")
    return folder


def test_the_example_of_the_format(tmp_path):
    for source in (campaign(tmp_path), tmp_path / "campaign.toml"):
        c = load_campaign(source)
        assert c.folder == tmp_path
        assert c.rig.name == "hmb_free" and c.rig.mass == c.mass == 0.0801
        (r,) = c.recordings
        assert (r.file, r.role, r.sample_rate, r.start, r.samples, r.periods) == (
            "run1.npz",
            "fit",
            2e4,
            0,
            120_000,
            6,
        )
        assert r.gains == Gains(8000.0, 2000.0, 5.2, 1e-4, 0.0318)
        assert r.excitations == (Excitation("sphs", "force", 1.0, tuple(range(1, 251)), 3.0),)
        assert r.samples_per_period == 20_000 and r.intersample is None
        assert r.channels["displacement"] == ChannelSource(("y_left", "y_right"), (0.5, 0.5), 1.25e-4, 0.0)
        assert r.channels["command"] == ChannelSource(("u",), (1.0,), 1.0, 0.0)


def test_mass_alone_replaces_the_rig(tmp_path):
    c = load_campaign(campaign(tmp_path, TOML.replace('rig = "hmb_free"\n', "")))
    assert c.rig is None and c.mass == 0.0801


def test_rig_beside_the_campaign(tmp_path):
    rig = (Path(__file__).parents[3] / "maglev_env/rigs/pedestal.toml").read_text()
    (tmp_path / "mine.toml").write_text(rig)
    c = load_campaign(campaign(tmp_path, TOML.replace("hmb_free", "mine.toml").replace("0.0801", "0.8")))
    assert c.rig.support_stiffness == load_rig("pedestal").support_stiffness and c.mass == 0.8


def test_controller_two_excitations_and_axes(tmp_path):
    text = TOML.replace(GAINS, "controller = { numerator = [1.0], denominator = [1, -0.5] }")
    text = text.replace(
        EXCITATION,
        'excitation = [{ kind = "sphs", lines = [1, 3], amplitude = 1, periods = 6 },\n'
        '  { kind = "sphs", at = "current", lines = [2, 4], amplitude = 0.1 }]',
    )
    r = load_campaign(campaign(tmp_path, text + 'speed_x = { from = "n", scale = 0.10472 }\n')).recordings[0]
    assert r.gains == LinearController((1.0,), (1.0, -0.5))
    assert [e.at for e in r.excitations] == ["force", "current"] and r.samples == 120_000
    assert "speed_x" in r.channels


def test_no_excitation_takes_all_samples(tmp_path):
    r = load_campaign(campaign(tmp_path, TOML.replace(EXCITATION, 'excitation = { kind = "none" }'))).recordings[0]
    assert r.samples is None and r.samples_per_period is None


MULTISINE = 'excitation = {{ kind = "{}", at = "{}", lines = [1, 3] }}'


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('"maglev-campaign/1"', '"maglev-campaign/2"', ["schema = 'maglev-campaign/2'", '"maglev-campaign/1"']),
        ("[parameters]", "[parameter]", ["unknown key 'parameter'", "parameters, recording, rig, schema"]),
        ("mass = 0.0801", "weight = 1", ["[parameters]", "unknown key 'weight'", "mass"]),
        ("mass = 0.0801", "mass = -1", ["mass = -1 kg"]),
        ("mass = 0.0801", 'mass = "x"', ["mass = 'x'"]),
        ('rig = "hmb_free"', 'rig = "hmb_fre"', ["'hmb_fre'", "hmb_free"]),
        ('rig = "hmb_free"', 'rig = "/etc/x.toml"', ["rig = '/etc/x.toml'", "relative"]),
        ('rig = "hmb_free"', "rig = 3", ["rig = 3"]),
        ('rig = "hmb_free"\n\n[parameters]\nmass', "[parameters]\ngap", ["without a rig", "unknown key 'gap'"]),
        (TOML[TOML.index("[[recording") :], "", ["no [[recording]]"]),
        ('role = "fit"', 'rolle = "fit"', ["recording 1 (run1.npz)", "unknown key 'rolle'", "role"]),
        ('role = "fit"', 'role = "test"', ["run1.npz", "role = 'test'", "fit, holdout"]),
        ("start = 0", 'intersample = "foh"', ["intersample = 'foh'", "bl, zoh"]),
        ('file = "run1.npz"\n', "", ["recording 1", "file = None"]),
        ("run1.npz", "../run1.npz", ["'../run1.npz' leaves the campaign folder"]),
        ("run1.npz", "/run1.npz", ["leaves the campaign folder"]),
        ("run1.npz", "C:\\\\run1.npz", ["leaves the campaign folder"]),
        ("run1.npz", "a\\\\..\\\\..\\\\run1.npz", ["leaves the campaign folder"]),
        ("run1.npz", "link/x.npz", ["leaves the campaign folder"]),
        ("run1.npz", "run\\u0000.npz", ["recording 1"]),
        ("sample_rate = 20000.0\n", "", ["run1.npz", "sample_rate is missing"]),
        ("sample_rate = 20000.0", "sample_rate = -5.0", ["sample_rate = -5.0 Hz"]),
        ("sample_rate = 20000.0", "sample_rate = true", ["sample_rate = True"]),
        ("start = 0", "start = -1", ["start = -1", "whole number"]),
        ("start = 0", "samples = 5", ["samples = 5", "6 periods of 20000", "120000"]),
        ("speed_rpm = 0.0", "speed_rpm = nan", ["speed_rpm = nan"]),
        ("kd = 5.2, ", "", ["gains: kd missing"]),
        ("kd = 5.2", "kq = 5.2", ["gains: unknown key 'kq'", "kd"]),
        ("kd = 5.2", 'kd = "a"', ["gains: kd = 'a'"]),
        (GAINS, "gains = { x = { kp = 1.0, ki = 0.0, kd = 0.0 } }", ["gains: axis y has none", "gains.y"]),
        (GAINS, "gains = { x = { kp = 1.0 }, y = { kp = 1.0 } }", ["gains.x: ki, kd missing"]),
        (
            "speed_rpm = 0.0",
            "controller = { numerator = [1] , denominator = [1] }",
            ["gains or a controller, not both"],
        ),
        (GAINS, "controller = { numerator = [1, 2], denominator = [1] }", ["controller", "would need the future"]),
        (GAINS, "controller = { numerator = [1] }", ["controller: denominator missing"]),
        (EXCITATION, "", ["excitation is missing", '"none"']),
        ("periods = 6", "period = 6", ["unknown key 'period'", "harmonics", "periods"]),
        ("periods = 6", "periods = 1", ["periods = 1", "at least 2"]),
        ("harmonics = [1, 250]", "harmonics = [1, 10000]", ["run1.npz", "harmonics: 10000", "10000 Hz"]),
        ("harmonics = [1, 250]", "harmonics = [1, 100000000000]", ["harmonics: 100000000000"]),
        ("harmonics = [1, 250]", "lines = [1, 2.5]", ["lines: 2.5"]),
        ("harmonics = [1, 250]", "lines = 4", ["lines = 4"]),
        ("fundamental = 1.0", "fundamental = 0.3712345", ["run1.npz", "only 221 periods together"]),
        ("fundamental = 1.0", "fundamental = 0.0", ["fundamental = 0.0"]),
        ('kind = "sphs"', 'kind = "chirp"', ["kind = 'chirp'", "multisine"]),
        (EXCITATION, MULTISINE.format("multisine", "current"), ["multisine at current", "channel injection", "phases"]),
        (EXCITATION, MULTISINE.format("multisine", "reference"), ["needs the channel reference"]),
        (EXCITATION, 'excitation = { kind = "recorded", at = "current" }', ["recorded", "channel injection"]),
        (EXCITATION, 'excitation = { kind = "none", periods = 4 }', ["periods has no meaning"]),
        (
            EXCITATION,
            f"excitation = [{EXCITATION[13:]}, {EXCITATION[13:].replace('force', 'current')}]",
            ["line 1 is excited at both force and current"],
        ),
        (
            EXCITATION,
            'excitation = [{ kind = "sphs", lines = [1], periods = 3 }, { kind = "sphs", lines = [2], periods = 4 }]',
            ["periods [3, 4] differ"],
        ),
        (
            'command      = { from = "u" }',
            'comand = { from = "u" }',
            ["unknown key 'comand'", "command", "gap_estimate"],
        ),
        ('{ from = "u" }', '"u"', ["channel command = 'u'", "table"]),
        ('{ from = "u" }', "{ scale = 2.0 }", ["channel command: from = None"]),
        ('{ from = "u" }', '{ from = "u", gain = 2.0 }', ["channel command: unknown key 'gain'", "scale"]),
        ('{ from = "u" }', '{ from = "u", scale = 0 }', ["channel command: scale = 0"]),
        ('{ from = "u" }', '{ from = "u", offset = inf }', ["channel command: offset = inf"]),
        ("weights = [0.5, 0.5], ", "", ["channel displacement: weights are missing"]),
        ("[0.5, 0.5]", "[0.5]", ["channel displacement: 1 weights for 2 columns"]),
        ("mass = 0.0801", "mass = " + "9" * 400, ["campaign.toml"]),
        ("mass = 0.0801", "mass = ", ["line 5"]),
        ("mass = 0.0801", "mass = " + "[" * 5000, ["campaign.toml"]),
    ],
)
def test_each_error_names_the_file_and_the_key(tmp_path, old, new, words):
    assert old in TOML
    (tmp_path / "link").symlink_to("/")
    campaign(tmp_path, TOML.replace(old, new, 1))
    with pytest.raises(ValueError) as error:
        load_campaign(tmp_path)
    for word in [str(tmp_path / "campaign.toml"), *words]:
        assert word in str(error.value)


def test_sphs_at_the_current_may_lack_its_channel(tmp_path):
    load_campaign(campaign(tmp_path, TOML.replace('at = "force"', 'at = "current"')))


def test_missing_files_are_os_errors(tmp_path):
    with pytest.raises(OSError, match=r"campaign\.toml"):
        load_campaign(tmp_path / "campaign.toml")
    campaign(tmp_path)
    (tmp_path / "run1.npz").unlink()
    with pytest.raises(FileNotFoundError, match=r"run1\.npz: the campaign names this file"):
        load_campaign(tmp_path)


def test_a_huge_campaign_file_is_not_read(tmp_path):
    campaign(tmp_path, TOML + "#" * 1_000_000)
    with pytest.raises(ValueError, match="not a campaign file"):
        load_campaign(tmp_path)


def test_text_that_is_not_utf8(tmp_path):
    campaign(tmp_path)
    (tmp_path / "campaign.toml").write_bytes(b"\xff\xfe")
    with pytest.raises(ValueError, match=r"campaign\.toml.*utf-8"):
        load_campaign(tmp_path)


values = st.one_of(
    st.text(st.characters(codec="utf-8")),
    st.integers(-(2**53), 2**53),
    st.floats(allow_nan=False, allow_infinity=False),
)


@given(value=st.one_of(values, st.lists(values, max_size=60)))
def test_toml_values_come_back(value):
    assert tomllib.loads(f"key = {toml_value(value)}\n")["key"] == value


PLANAR = """schema = "maglev-campaign/1"
rig = "hmb_radial"

[[recording]]
file = "run1.npz"
sample_rate = 20000.0

[recording.gains.x]
kp = 8000.0
ki = 2000.0
kd = 5.2
[recording.gains.y]
kp = 9000.0
ki = 2000.0
kd = 6.0

[[recording.excitation]]
kind = "multisine"
at = "force"
harmonics = [1, 250]
direction = 30.0
amplitude = 1.5
seed = 3
[[recording.excitation]]
kind = "low_crest"
at = "current"
fundamental = 1.0
lines = [251, 300]
direction = 90.0
amplitude = 0.1

[recording.channels]
force_x = { from = "fx" }
force_y = { from = "fy" }
injection_y = { from = "iy" }
displacement_x = { from = ["a", "b"], weights = [0.7, 0.7] }
displacement_y = { from = ["a", "b"], weights = [-0.7, 0.7] }
"""


def test_two_axes(tmp_path):
    (r,) = load_campaign(campaign(tmp_path, PLANAR)).recordings
    assert r.gains == (Gains(8000.0, 2000.0, 5.2), Gains(9000.0, 2000.0, 6.0))
    assert [(e.kind, e.at, e.direction, e.seed) for e in r.excitations] == [
        ("multisine", "force", 30.0, 3),
        ("low_crest", "current", 90.0, 0),
    ]
    assert r.channels["displacement_y"] == ChannelSource(("a", "b"), (-0.7, 0.7))
    assert r.samples_per_period == 20_000 and r.role == "fit" and r.periods is None


def test_a_controller_of_each_axis(tmp_path):
    first, rest = PLANAR.split("[recording.gains.x]")
    tables = """[recording.controller.x]
numerator = [2.0, -1.5]
denominator = [1, -0.5]
[recording.controller.y]
numerator = [3.0]
denominator = [1.0, 0.0, 0.25]
"""
    text = first + tables + rest[rest.index("[[recording.excitation") :]
    assert load_campaign(campaign(tmp_path, text)).recordings[0].gains == (
        LinearController((2.0, -1.5), (1, -0.5)),
        LinearController((3.0,), (1.0, 0.0, 0.25)),
    )


def test_a_recorded_excitation_with_its_band_and_direction(tmp_path):
    start, stop = PLANAR.index("[[recording.excitation"), PLANAR.index("[recording.channels")
    one = 'excitation = { kind = "recorded", direction = 30.0, band = [2.0, 400.0] }\n'
    text = PLANAR[:start] + PLANAR[stop:]
    (r,) = load_campaign(
        campaign(tmp_path, text.replace("[recording.gains.x]", one + "[recording.gains.x]"))
    ).recordings
    assert r.excitations == (Excitation("recorded", direction=30.0, band=(2.0, 400.0)),)
    assert r.samples is None and r.samples_per_period is None


ONE_AXIS = PLANAR.replace("_x =", " =", 2).replace("force_y", "current").replace("displacement_y", "command")
RECORDED = 'kind = "recorded"\nat = "force"\n'


@pytest.mark.parametrize(
    ("text", "old", "new", "words"),
    [
        (ONE_AXIS.replace("injection_y", "injection"), "", "", ["direction", "channels of two axes, force_x, force_y"]),
        (PLANAR, "direction = 30.0", "direction = nan", ["direction = nan", "degrees"]),
        (PLANAR, "[recording.gains.y]", "[recording.gains.z]", ["gains: unknown key 'z'", "known keys: x, y"]),
        (PLANAR, PLANAR[PLANAR.index("[recording.gains.y]") : PLANAR.index("[[recording.ex")], "", ["gains: axis y"]),
        (PLANAR, "kd = 6.0", "numerator = [1.0]", ["gains.y", "unknown key 'kp'", "denominator, limit, numerator"]),
        (PLANAR, "kd = 6.0", "", ["gains.y: kd missing"]),
        (PLANAR, "force_y", "force_w", ["unknown key 'force_w'", "force_x", "displacement_y"]),
        (PLANAR, "[0.7, 0.7] }\ndisp", "[0.7] }\ndisp", ["channel displacement_x: 1 weights for 2 columns"]),
        (PLANAR, "[-0.7, 0.7]", '["a", 0.7]', ["channel displacement_y: weights", "give finite numbers"]),
        (PLANAR, "[-0.7, 0.7]", "0.7", ["channel displacement_y: weights = 0.7", "give a list"]),
        (PLANAR, 'injection_y = { from = "iy" }', "", ["low_crest at current needs the channel injection", "phases"]),
        (PLANAR, "lines = [251, 300]", "lines = [250, 300]", ["line 250 is excited at both"]),
        (PLANAR, "fundamental = 1.0", "fundamental = 2.0", ["fundamentals [1.0, 2.0] differ"]),
        (PLANAR, "seed = 3", "band = [1.0, 5.0]", ["band = (1.0, 5.0) Hz", "recorded"]),
        (PLANAR, 'kind = "multisine"\nat = "force"\nharmonics = [1, 250]', RECORDED + "band = [-1, 5]", ["(-1, 5) Hz"]),
        (PLANAR, 'kind = "multisine"\nat = "force"\nharmonics = [1, 250]', RECORDED + "band = [5, 1]", ["[5, 1]"]),
        (
            PLANAR,
            'kind = "multisine"\nat = "force"\nharmonics = [1, 250]',
            RECORDED + "band = 5",
            ["band = 5 must be two"],
        ),
        (
            PLANAR.replace("force_x", "speed_x").replace("force_y", "speed_y"),
            'kind = "multisine"\nat = "force"\nharmonics = [1, 250]',
            RECORDED,
            ["recorded at force needs the channel force", "its waveform is that channel"],
        ),
        (TOML, GAINS, "controller = { numerator = [2.0], denominator = [2, 1] }", ["starts with 2, not 1", "divide"]),
        (TOML, GAINS, "controller = { numerator = [2.0], denominator = [0, 1] }", ["starts with 0, not 1", "leading"]),
        (TOML, GAINS, "controller = { numerator = [], denominator = [1] }", ["controller: numerator = ()"]),
        (TOML, GAINS, 'controller = { numerator = [1], denominator = [1, "a"] }', ["denominator = (1, 'a')", "finite"]),
        (TOML, GAINS, "controller = { x = { numerator = [1], denominator = [1] } }", ["controller: axis y has none"]),
        (TOML, GAINS, "gains = 5", ["gains = 5 must be a table"]),
        (TOML, GAINS, "gains = { x = 5, y = 6 }", ["gains.x = 5 must be a table"]),
        (TOML, "mass = 0.0801", "axes = 2", ["[parameters]: unknown key 'axes'"]),
    ],
)
def test_each_error_of_axes_controllers_and_recorded_excitations(tmp_path, text, old, new, words):
    assert old in text
    campaign(tmp_path, text.replace(old, new, 1))
    with pytest.raises(ValueError) as error:
        load_campaign(tmp_path)
    for word in [str(tmp_path / "campaign.toml"), *words]:
        assert word in str(error.value)


@pytest.mark.parametrize(
    ("old", "new", "word"),
    [
        ("direction = 30.0", 'direction = "up"', "direction"),
        ("direction = 30.0", "direction = [30.0]", "direction"),
        ("amplitude = 1.5", "amplitude = []", "amplitude"),
        ("kp = 9000.0", "kp = inf", "gains.y"),
        ("kp = 9000.0", "kp = " + "9" * 400, "gains.y"),
    ],
)
def test_a_wrong_type_names_its_key(tmp_path, old, new, word):
    campaign(tmp_path, PLANAR.replace(old, new, 1))
    with pytest.raises(ValueError) as error:
        load_campaign(tmp_path)
    assert word in str(error.value).removeprefix(str(tmp_path))


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("seed = 3", 'seed = "x"'),
        ("seed = 3", "seed = [1]"),
        ("seed = 3", "seed = -1"),
        ("seed = 3", "seed = 1.5"),
        ("direction = 30.0", "direction = true"),
        ("amplitude = 1.5", "amplitude = true"),
    ],
)
def test_a_value_of_another_type_is_not_let_in(tmp_path, old, new):
    campaign(tmp_path, PLANAR.replace(old, new, 1))
    with pytest.raises(ValueError, match=new.split()[0]):
        load_campaign(tmp_path)


def test_gains_of_an_axis_have_no_axes(tmp_path):
    one = "{ kp = 1.0, ki = 1.0, kd = 1.0 }"
    campaign(tmp_path, TOML.replace(GAINS, f"gains = {{ x = {{ x = {one}, y = {one} }}, y = {one} }}"))
    with pytest.raises(ValueError, match=r"gains\.x"):
        load_campaign(tmp_path)


HOSTILE = (
    '"x"', '""', "true", "[]", "{}", "[{}]", "nan", "-inf", "0", "-1", "1e308", "9" * 30, "9" * 400, "1979-05-27",
    "[nan, inf]", '["a", "b"]', "[[1], [2]]", "[2, 1]", "[" * 80 + "]" * 80, "{ x = { x = 1 }, y = 2 }",
)  # fmt: skip


@pytest.mark.parametrize("number", [i for i, line in enumerate(PLANAR.splitlines()) if " = " in line])
def test_no_value_of_any_key_ends_in_another_error(tmp_path, number):
    """Every key takes every hostile value: it is read, refused by a ValueError, or names a missing file."""
    lines = PLANAR.splitlines()
    key = lines[number].partition(" = ")[0]
    campaign(tmp_path)
    for value in HOSTILE:
        lines[number] = f"{key} = {value}"
        (tmp_path / "campaign.toml").write_text("\n".join(lines))
        try:
            load_campaign(tmp_path)
        except FileNotFoundError:
            assert key in ("file", "rig")
        except ValueError as error:
            assert "campaign.toml" in str(error)


EXCITATION_KEYS = {
    "kind": '"sphs"', "at": '"force"', "fundamental": "1.0", "lines": "[1, 2]", "amplitude": "1.0", "direction": "30.0",
}  # fmt: skip


@settings(deadline=None)
@given(
    key=st.sampled_from([*EXCITATION_KEYS, "band", "seed", "harmonics", "periods"]),
    value=st.recursive(values, lambda inner: st.lists(inner, max_size=4), max_leaves=12),
)
def test_no_value_of_an_excitation_ends_in_another_error(tmp_path_factory, key, value):
    folder = tmp_path_factory.getbasetemp() / "hostile"
    folder.mkdir(exist_ok=True)
    table = {**EXCITATION_KEYS, key: toml_value(value)}
    start, stop = PLANAR.index("[[recording.excitation"), PLANAR.index("[recording.channels")
    text = "\n".join(["[[recording.excitation]]", *(f"{name} = {v}" for name, v in table.items()), ""])
    campaign(folder, PLANAR[:start] + text + PLANAR[stop:])
    try:
        load_campaign(folder)
    except ValueError as error:
        assert "campaign.toml" in str(error)
