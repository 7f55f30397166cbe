"""Can somebody else use the processes of `--scheduler local:N`? Try it from outside, and as another user if possible.

    python tests/tools/daskopen.py [--unprotected]

Two worker processes are started as the commands start them. A process that is no child of theirs, under the user
`nobody` if this one may change users, then reads which ports listen and attacks each: as a Dask client without
encryption, as one with a certificate of its own, as a TLS client that accepts any server, and as a browser. It also
tries to read the folder of the workers. Exit status 0: everything was refused; 1: something was open, which is named.
With --unprotected the same attacks meet a cluster as Dask starts it by itself; they must then succeed, which
shows that they can.
"""

import argparse
import asyncio
import json
import logging
import os
import socket
import ssl
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from threading import Thread
from urllib.error import HTTPError
from urllib.request import urlopen

NOBODY = 65534
WAIT, PATIENCE = 2.0, 6.0  # s for each attempt, and for all of them together
# Not /sitemap.json: it cannot be removed, and says which other pages there are, which is none.
PAGES = ("", "status", "health", "metrics", "info/main/workers.html", "json/counts.json", "api/v1")


def listening(pids: set[int]) -> list[int]:
    """TCP ports on which these processes listen."""
    inodes = set()
    for pid in pids:
        for descriptor in Path(f"/proc/{pid}/fd").iterdir():
            target = str(descriptor.readlink()) if descriptor.is_symlink() else ""
            if target.startswith("socket:["):
                inodes.add(target[8:-1])
    ports = set()
    for table in ("/proc/net/tcp", "/proc/net/tcp6"):
        for line in Path(table).read_text().splitlines()[1:]:
            _, local, _, state, *rest = line.split()
            if state == "0A" and rest[5] in inodes:
                ports.add(int(local.rpartition(":")[2], 16))
    return sorted(ports)


def as_client(port: int, protocol: str) -> str | None:
    """Run code through the scheduler or worker that listens there."""
    from distributed import Client, Security

    security = Security.temporary() if protocol == "tls" else None
    with Client(f"{protocol}://127.0.0.1:{port}", timeout=WAIT, set_as_default=False, security=security) as client:
        return f"ran code as user {client.submit(os.getuid, pure=False).result(WAIT)}"


def as_worker(port: int) -> str | None:
    """Ask what listens there directly, as a scheduler asks a worker."""
    from distributed import rpc

    async def ask() -> str:
        async with rpc(f"tcp://127.0.0.1:{port}") as there:
            return f"told its identity: {sorted(await there.identity())[:3]}"

    return asyncio.run(asyncio.wait_for(ask(), WAIT))


def accepting_any_server(port: int, certified: bool) -> str | None:
    """Wait for the greeting of a TLS server, whoever it is, with a certificate of one's own or none."""
    from distributed import Security

    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    with tempfile.TemporaryDirectory() as folder:
        if certified:
            own = Security.temporary()
            for name, text in (("cert", own.tls_client_cert), ("key", own.tls_client_key)):
                Path(folder, name).write_text(text)
            context.load_cert_chain(Path(folder, "cert"), Path(folder, "key"))
    with (
        socket.create_connection(("127.0.0.1", port), WAIT) as plain,
        context.wrap_socket(plain) as encrypted,
    ):
        greeting = encrypted.recv(64)
        return f"greeted with {greeting!r}" if greeting else None


def as_browser(port: int) -> str | None:
    """Read any of Dask's pages."""
    found = []
    for page in PAGES:
        try:
            with urlopen(f"http://127.0.0.1:{port}/{page}", timeout=WAIT) as answer:
                found.append(f"/{page} ({len(answer.read())} bytes)")
        except HTTPError:
            continue
    return f"pages {', '.join(found)}" if found else None


def in_folder(folder: str) -> str | None:
    """Read the folder of the workers."""
    if os.getuid() == Path(folder).stat().st_uid:
        return None  # this user's own
    return f"readable: {[path.name for path in Path(folder).iterdir()]}"


def attack(ports: list[int], folder: str) -> dict[str, str]:
    """What was open, by attempt, as JSON data."""
    logging.disable(logging.CRITICAL)
    attempts: dict[str, Callable[[], str | None]] = {f"folder {folder}": lambda: in_folder(folder)}
    for port in ports:
        attempts |= {
            f"port {port}, client without encryption": lambda port=port: as_client(port, "tcp"),
            f"port {port}, client with its own certificate": lambda port=port: as_client(port, "tls"),
            f"port {port}, worker's handlers": lambda port=port: as_worker(port),
            f"port {port}, TLS without certificate": lambda port=port: accepting_any_server(port, False),
            f"port {port}, TLS with its own certificate": lambda port=port: accepting_any_server(port, True),
            f"port {port}, browser": lambda port=port: as_browser(port),
        }
    found = dict.fromkeys(attempts, "")

    def make(name: str) -> None:
        with suppress(Exception):  # however an attempt is refused
            found[name] = attempts[name]() or ""

    # Together, and given up after a while: a Dask client may wait for ever at a port where something else listens.
    threads = [Thread(target=make, args=(name,), daemon=True) for name in attempts]
    for thread in threads:
        thread.start()
    until = time.monotonic() + PATIENCE
    for thread in threads:
        thread.join(max(0.0, until - time.monotonic()))
    return dict(found)


def from_outside(ports: list[int], folder: str) -> dict[str, str]:
    """The same from a process outside the tree, as nobody if this user may."""
    change = ["setpriv", f"--reuid={NOBODY}", f"--regid={NOBODY}", "--clear-groups"] if os.getuid() == 0 else []
    with tempfile.TemporaryDirectory(prefix="outside-") as home:
        Path(home).chmod(0o777)
        told = Path(home, "told.json")
        command = [*change, sys.executable, __file__, "--attack", json.dumps(ports), folder, str(told)]
        # The shell ends at once, so that the attacker is no child of this process; it tells its findings by a file.
        subprocess.run(
            ["sh", "-c", '"$@" >/dev/null 2>&1 &', "sh", *command], cwd=home, check=True,
            env={**os.environ, "HOME": home, "TMPDIR": home},
        )  # fmt: skip
        for _ in range(600):
            if told.exists():
                return json.loads(told.read_text())
            time.sleep(0.1)
    raise TimeoutError("the attacker has not ended")


@contextmanager
def cluster(unprotected: bool) -> Iterator[tuple[set[int], str]]:
    """The processes of two workers and of what started them, and the folder of the workers."""
    from distributed import Client, LocalCluster

    from maglev_lanes.schedule import workers

    with ExitStack() as stack:
        if unprotected:
            folder = stack.enter_context(tempfile.TemporaryDirectory())
            Path(folder).chmod(0o755)
            local = LocalCluster(
                n_workers=2,
                threads_per_worker=1,
                memory_limit=0,
                local_directory=folder,
                dashboard_address="127.0.0.1:0",
            )
            client = stack.enter_context(Client(stack.enter_context(local)))
        else:
            client = stack.enter_context(workers("local:2"))._client
            folder = next(iter(client.run(lambda dask_worker: dask_worker.local_directory).values()))
            folder = str(Path(folder).parent.parent)
        yield {os.getpid(), *client.run(os.getpid).values()}, folder


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--unprotected", action="store_true", help="attack a cluster as Dask starts it by itself")
    parser.add_argument("--attack", nargs=3, help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.attack:
        ports, folder, told = asked.attack
        found = attack(json.loads(ports), folder)
        part = Path(told + ".part")
        part.write_text(json.dumps(found))
        part.rename(told)
        os._exit(0)  # whatever attempts still wait
    with cluster(asked.unprotected) as (pids, folder):
        ports = listening(pids)
        found = from_outside(ports, folder)
    who = "nobody" if os.getuid() == 0 else "the same user, who may not change users"
    print(f"{len(found)} attempts on {len(ports)} ports and one folder, as {who}:")
    for name, how in found.items():
        print(f"  {name}: {how or 'refused'}")
    opened = [name for name, how in found.items() if how]
    print(f"{len(opened)} of {len(found)} succeeded")
    return 1 if opened else 0


if __name__ == "__main__":
    sys.exit(main())
