"""Files and folders that may not be read or written: one sentence with exit code 2, and nothing is touched."""

import os
import shutil
import subprocess
import sys

import pytest
from command_line import CAMPAIGN


@pytest.fixture(scope="module")
def bound(tmp_path_factory):
    """What runs a command so that rights bind it: root must give up the capability that overrides them."""
    drop = []
    if os.name != "posix":
        pytest.skip("rights are those of POSIX")
    if os.getuid() == 0:
        if not (setpriv := shutil.which("setpriv")):
            pytest.skip("needs setpriv, or a user who is not root")
        drop = [setpriv, "--inh-caps=-all", "--bounding-set=-dac_override,-dac_read_search"]
    closed = tmp_path_factory.mktemp("rights") / "closed"
    closed.touch(mode=0o000)
    if subprocess.run([*drop, "cat", closed], capture_output=True).returncode == 0:
        pytest.skip("rights bind nobody here")
    return drop


def refused(bound, *words):
    command = [*bound, sys.executable, "-m", "maglev_workbench.cli", *map(str, words)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 2 and done.stderr.count("\n") == 1 and "Traceback" not in done.stderr
    return done.stderr


def test_a_data_file_that_may_not_be_read_is_named(bound, tmp_path):
    (tmp_path / "campaign.toml").write_text(CAMPAIGN)
    (tmp_path / "a.csv").touch(mode=0o000)
    said = refused(bound, "estimate", tmp_path)
    assert (
        said
        == f"maglev: {tmp_path / 'a.csv'}: no permission for it; change its rights, or name another file or folder\n"
    )


def test_a_campaign_whose_page_may_not_be_written_is_refused_before_any_work(bound, tmp_path):
    folder = tmp_path / "campaign"
    folder.mkdir()
    (folder / "campaign.toml").write_text(CAMPAIGN)
    (folder / "a.csv").write_text("y\n1\n")
    folder.chmod(0o555)
    assert f"the folder {folder} cannot be written to; choose another" in refused(bound, "check", folder)


@pytest.mark.slow
def test_a_result_folder_that_became_read_only_keeps_what_it_holds(bound, tmp_path):
    words = ("sweep", "--kp", "7000:9000:2", "--threads", "1", "--out", tmp_path / "out")
    subprocess.run([sys.executable, "-m", "maglev_workbench.cli", *map(str, words)], check=True, capture_output=True)
    before = {path.name: path.read_bytes() for path in (tmp_path / "out").iterdir() if path.is_file()}
    (tmp_path / "out" / "lock").chmod(0o444)
    assert "no permission for it" in refused(bound, *words)
    (tmp_path / "out").chmod(0o555)
    assert "cannot be written to; choose another" in refused(bound, *words)
    assert before == {path.name: path.read_bytes() for path in (tmp_path / "out").iterdir() if path.is_file()}
