"""Fusers and routers that are held up for a moment, over and over: what an outsider hears twice, misses, and waits for."""

from __future__ import annotations

import argparse
import json
import random
import time
from collections.abc import Callable
from dataclasses import asdict

from milepost.chaos.stack import NORMAL_S, Stack

WHO: dict[str, Callable[[Stack, random.Random], str]] = {
    "the fuser that leads": lambda stack, _: stack.leader,
    "the fuser that stands by": lambda stack, _: stack.standby,
    "either fuser": lambda stack, rng: rng.choice([stack.leader, stack.standby]),
    "the router in use": lambda stack, _: stack.router,
}


def main() -> None:
    """Stop each of them again and again with SIGSTOP, and print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--train", default="full", help="a train with two fusers, a file or a name")
    parser.add_argument("--for", type=float, default=15.0, dest="for_s", help="seconds for each of them")
    parser.add_argument("--shortest", type=float, default=0.02, help="shortest stop in seconds")
    parser.add_argument("--longest", type=float, default=0.15, help="longest stop in seconds")
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    for name, who in WHO.items():
        rng, stops = random.Random(asked.seed), 0
        with Stack(asked.train) as stack:
            stack.recovered(NORMAL_S)
            with stack.measured() as seen:
                end = time.monotonic() + asked.for_s
                while time.monotonic() < end:
                    stack.stop(who(stack, rng), rng.uniform(asked.shortest, asked.longest))
                    stops += 1
                    time.sleep(rng.uniform(0.1, 0.6))
                stack.recover(seen)
        print(json.dumps({"stopped": name, "stops": stops, **asdict(seen)}))


if __name__ == "__main__":
    main()
