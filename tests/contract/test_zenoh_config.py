"""deploy/zenoh/router.json5 is the router that the tests and `milepost up` run."""

from __future__ import annotations

import json
from pathlib import Path

import zenoh

from milepost.runtime import zenoh_config

DEPLOY = Path(__file__).parents[2] / "deploy"


def test_the_router_file_agrees_with_the_code() -> None:
    # read by Zenoh itself, defaults filled in, as zenohd would
    in_file = json.loads(str(zenoh.Config.from_file(str(DEPLOY / "zenoh" / "router.json5"))))
    in_code = json.loads(str(zenoh.Config.from_json5(json.dumps(zenoh_config.router(["tcp/0.0.0.0:7447"])))))
    assert in_file == in_code
    assert in_file["mode"] == "router"
