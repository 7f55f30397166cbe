"""What is said of a text that is no TOML."""

import pytest

from maglev_env.fields import toml_tables
from maglev_env.rig.rig_file import rig_from_toml


@pytest.mark.parametrize("value", [".05", "1,5", "5.", "free"])
def test_the_line_that_is_wrong_is_shown(value):
    text = f'schema = "maglev-rig/1"\n[parameters]\nmass = {value}\n'
    with pytest.raises(ValueError, match=rf"line 3.*: 'mass = {value}'; numbers are written 0.05"):
        toml_tables(text)
    with pytest.raises(ValueError, match=r"rig\.toml: .*numbers are written"):
        rig_from_toml(text, "rig.toml")


def test_a_text_that_ends_too_early_is_said_to():
    with pytest.raises(ValueError, match="end of document"):
        toml_tables("[parameters")
