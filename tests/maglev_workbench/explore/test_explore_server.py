"""The local server: who may ask, what is refused, and that its answers are the functions' own."""

import base64
import http.client
import json
import os
import re
import signal
import socket
import subprocess
import sys
from contextlib import contextmanager
from threading import Thread

import numpy as np
import pytest
import uvicorn

from maglev_env.design.defaults import with_defaults
from maglev_env.rig.rig_file import load_rig
from maglev_workbench.explore.copied import Source
from maglev_workbench.explore.curves import loop_curves
from maglev_workbench.explore.guard import MOST_BYTES
from maglev_workbench.explore.server import Explored, application
from maglev_workbench.explore.setting import setting_from

RIG = with_defaults(load_rig("hmb_free"))
TOKEN = "secret-of-this-test"
JSON = {"Content-Type": "application/json"}


@contextmanager
def serving():
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        listening.listen()
        host = f"127.0.0.1:{listening.getsockname()[1]}"
        explored = Explored(RIG, RIG.gains, Source("hmb_free", "load_rig('hmb_free')"), "hmb_free")
        server = uvicorn.Server(uvicorn.Config(application(explored, TOKEN, host), log_level="error", access_log=False))
        thread = Thread(target=server.run, kwargs={"sockets": [listening]}, daemon=True)
        thread.start()
        yield host
        server.should_exit = True
        thread.join(10)


@pytest.fixture(scope="module")
def host():
    with serving() as address:
        yield address


def ask(host, method, path, body=None, headers=None):
    connection = http.client.HTTPConnection(host, timeout=120)
    connection.request(method, path, body, headers or {})
    answer = connection.getresponse()
    return answer.status, dict(answer.getheaders()), answer.read()


def post(host, name, data):
    status, _, body = ask(host, "POST", f"/{TOKEN}/{name}", json.dumps(data), JSON)
    assert status == 200, body
    return json.loads(body)


def test_the_page_and_its_parts_are_there_with_headers_that_keep_others_out(host):
    for path, kind in (("", "text/html"), ("explore.js", "javascript"), ("uPlot.iife.min.js", "javascript"),
                       ("explore.css", "text/css"), ("start", "application/json")):  # fmt: skip
        status, headers, body = ask(host, "GET", f"/{TOKEN}/{path}")
        assert status == 200 and body and kind in headers["content-type"]
        assert (
            headers["referrer-policy"] == "no-referrer" and "default-src 'none'" in headers["content-security-policy"]
        )
    page = ask(host, "GET", f"/{TOKEN}/")[2].decode()
    assert not re.search(r"""(?:src|href)=["'](?:https?:)?//""", page), "the page must not need the network"


@pytest.mark.parametrize(
    ("path", "headers", "status"),
    [
        ("/", {}, 404), ("/start", {}, 404), ("/wrong/start", {}, 404), (f"/{TOKEN}x/start", {}, 404),
        (f"/{TOKEN[:-1]}/", {}, 404), (f"//{TOKEN}/", {}, 404), (f"/{TOKEN}/start", {"Host": "evil.example"}, 421),
        (f"/{TOKEN}/start", {"Host": "127.0.0.1"}, 421), (f"/{TOKEN}/start", {"Host": "localhost:1"}, 421),
        (f"/{TOKEN}/../server.py", {}, 404), (f"/{TOKEN}/%2e%2e/server.py", {}, 404), (f"/{TOKEN}/curves", {}, 404),
        (f"/{TOKEN}/..%2f..%2f__init__.py", {}, 404),
    ],
)  # fmt: skip
def test_what_lacks_the_token_or_names_another_host_is_refused(host, path, headers, status):
    assert ask(host, "GET", path, headers=headers)[0] == status


def test_a_request_without_a_path_is_refused(host):
    assert ask(host, "OPTIONS", "*")[0] == 404


@pytest.mark.parametrize(
    ("body", "headers", "status"),
    [
        (b"{}", {"Content-Type": "text/plain"}, 415), (b"{", JSON, 400), (b"[]", JSON, 400), (b"[" * 50_000, JSON, 400),
        (b" " * (MOST_BYTES + 1), JSON, 413),
    ],
)  # fmt: skip
def test_what_no_page_would_send_is_refused(host, body, headers, status):
    assert ask(host, "POST", f"/{TOKEN}/curves", body, headers)[0] == status


def test_curves_are_those_of_the_functions(host):
    data = {"gains": {"kp": 9000.0}, "effects": {"delay": {"time": 1e-4}}, "units": "bench"}
    found, answer = loop_curves(setting_from(data, RIG, RIG.gains).experiment, 0), post(host, "curves", data)

    def curve(name, key):
        return np.frombuffer(base64.b64decode(answer["curves"][name][key]), "<f4")

    np.testing.assert_allclose(curve("stiffness", "y"), found.stiffness / 1e3, rtol=1e-5)
    np.testing.assert_allclose(curve("damping", "y"), found.damping, rtol=1e-5)
    np.testing.assert_allclose(curve("step", "x"), found.times * 1e3, rtol=1e-5)
    np.testing.assert_allclose(curve("sensitivity", "y"), np.abs(found.sensitivity), rtol=1e-5)
    assert "Stable" in answer["words"][0]["text"]


@pytest.mark.parametrize("data", [{"gains": {"kp": 1e999}}, {"gains": {"td": 0.0}}, {"effects": {"no": {}}}])
def test_a_wrong_setting_is_answered_with_a_sentence(host, data):
    assert post(host, "curves", data)["error"]


def test_an_experiment_and_the_table_have_what_was_identified(host):
    answer = post(host, "experiment", {"units": "bench"})
    assert "±" in answer["words"][-1]["text"] and "N/mm" in answer["words"][-1]["text"]
    table = post(host, "csv", {})["csv"].splitlines()
    assert table[0].startswith("layer,curve,x") and {"model", "identified"} <= {row.split(",")[0] for row in table}
    assert "no steady response" in post(host, "experiment", {"gains": {"kp": 500.0}})["error"]


@pytest.mark.slow
def test_the_command_serves_this_machine_alone_and_ctrl_c_closes_it(tmp_path):
    program = [sys.executable, "-m", "maglev_workbench", "explore", "hmb_free"]
    process = subprocess.Popen(program, stdout=subprocess.PIPE, text=True, cwd=tmp_path)
    lines = [process.stdout.readline() for _ in range(2)]
    at, token = re.fullmatch(r"http://(127\.0\.0\.1:\d+)/([\w-]{32,})/\n", lines[1]).groups()
    assert ask(at, "GET", f"/{token}/start")[0] == 200 and ask(at, "GET", "/start")[0] == 404
    os.kill(process.pid, signal.SIGINT)
    assert process.wait(60) == 0 and "closed" in process.stdout.read()
    assert not list(tmp_path.iterdir())
