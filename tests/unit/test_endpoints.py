"""What `--connect` takes for an endpoint: what Zenoh has links for, with an address."""

from __future__ import annotations

import subprocess
import sys

import pytest

from milepost.cli.options import endpoints
from milepost.config.errors import ConfigError

ENDPOINTS = ["tcp/127.0.0.1:7447", "tls/router.example:7447", "tcp/[::1]:7447", "quic/h:1?rel=1", "unixsock-stream//run/z.sock"]


def test_endpoints_are_taken_as_they_are() -> None:
    assert endpoints(ENDPOINTS) == ENDPOINTS
    assert endpoints([]) == []


@pytest.mark.parametrize(
    "given", ["", "garbage", "tcp/", "tcp/127.0.0.1", "tcp:127.0.0.1:7447", "foo/127.0.0.1:1", "serial/", "tcp/h:65536"]
)
def test_anything_else_is_one_line(given: str) -> None:
    with pytest.raises(ConfigError, match=r"^--connect: .* is not an endpoint such as tcp/127.0.0.1:7447$"):
        endpoints([ENDPOINTS[0], given])


def test_a_router_that_is_to_link_itself_with_nothing_says_so() -> None:
    command = [sys.executable, "-m", "milepost", "run", "router", "--link", "nonsense"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == "milepost: --link: 'nonsense' is not an endpoint such as tcp/127.0.0.1:7447\n"


def test_a_command_says_so_instead_of_looking_for_a_router_there() -> None:
    command = [sys.executable, "-m", "milepost", "status", "--connect", "garbage"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == "milepost: --connect: 'garbage' is not an endpoint such as tcp/127.0.0.1:7447\n"
