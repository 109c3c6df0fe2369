"""The vote does not depend on the order in which the three fusers speak."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from ballots import NAMES, at, candidate, voter
from milepost_schemas import Event

EPOCHS = 8
# honest, off by more than the tolerance, or silent
SAYS = st.sampled_from([0.0, 0.2, None])


@given(
    says=st.lists(
        st.fixed_dictionaries({"fuser": st.just(0.0), "fuser-2": SAYS, "fuser-3": SAYS}), min_size=EPOCHS, max_size=EPOCHS
    ),
    orders=st.lists(st.permutations(NAMES), min_size=EPOCHS, max_size=EPOCHS),
)
def test_any_order_gives_the_same_states_and_names_the_same_fusers(says, orders):
    def run(orders):
        node, out = voter(), []
        for n, (said, order) in enumerate(zip(says, orders, strict=True)):
            for unit in order:
                if said[unit] is not None:
                    out += node.step(candidate(unit, n, said[unit]), at(n))
            # everybody has spoken who will: the epoch is closed
            out += node.tick(at(n, 105.0))
        events = [m.message.text for m in out if isinstance(m.message, Event)]
        return [m.message.model_dump_json() for m in out if m.stream != "event"], events

    assert run(orders) == run([NAMES] * EPOCHS)
