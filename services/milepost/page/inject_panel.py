"""The part of a train's page with which faults are injected; shown only where the train allows it."""

from __future__ import annotations

from typing import Any

from nicegui import run, ui

from .heard import Heard
from .injecting import Answer, Injecting, Option, Order, faults_for, options_of, units_of, words_of

ASK_EVERY_S = 5.0
FOR_S = 10.0
WHAT_IT_DOES = "Makes a sensor of this running train lie. The sensor's device is not touched."


class _Panel:
    """What is chosen, and the inputs of the chosen fault's options."""

    def __init__(self, heard: Heard, train: str, injecting: Injecting) -> None:
        self._heard, self._train, self._injecting = heard, train, injecting
        self._options: list[Option] = []
        self._values: dict[str, Any] = {}
        with ui.element("div").classes("page") as self.card, ui.element("section").classes("card inject"):
            ui.html("<h2>Inject a fault</h2>", sanitize=False)
            ui.label(WHAT_IT_DOES).classes("quiet")
            with ui.element("div").classes("inputs"):
                self._unit = (
                    ui.select([], label="Sensor", on_change=self._unit_chosen).props("outlined dense").classes("choice")
                )
                self._fault = ui.select({}, label="Fault", on_change=self._fault_chosen)
                self._fault.props("outlined dense").classes("choice wide-choice")
                self._inputs = ui.element("div").classes("inputs")
                self._for_s = ui.number("For (s)", value=FOR_S).props("outlined dense")
                ui.button("Inject", on_click=self._inject).props("unelevated no-caps text-color=on-accent")
                ui.button("End all of this sensor", on_click=self._clear).props("outline no-caps")
            self._answer = ui.label().props('role="status"').classes("answer")
        self.card.set_visibility(False)

    async def look(self) -> None:
        """Show the panel where the train allows it, with the sensors that live."""
        allowed = await run.io_bound(self._injecting.allowed, self._train)
        found = self._heard.train(self._train)
        units = [] if found is None else units_of(found)
        self.card.set_visibility(bool(allowed and units))
        if units != self._unit.options:
            self._unit.set_options(units, value=self._unit.value if self._unit.value in units else units[0] if units else None)
        # what a sensor sends, and so which faults fit it, is known a second after it has come
        self._unit_chosen()

    def _unit_chosen(self) -> None:
        found = self._heard.train(self._train)
        health = None if found is None else found.healths.get(f"sensor-{self._unit.value}")
        faults = faults_for(health)
        if list(faults) != list(self._fault.options):
            self._fault.set_options(faults, value=self._fault.value if self._fault.value in faults else next(iter(faults)))

    def _fault_chosen(self) -> None:
        self._inputs.clear()
        self._options = options_of(self._fault.value) if self._fault.value else []
        self._values = {each.name: each.default for each in self._options}
        with self._inputs:
            for option in self._options:
                self._input(option)

    def _input(self, option: Option) -> None:
        name = option.name.replace("_", " ")
        if option.kind == "flag":
            made: Any = ui.checkbox(name, value=bool(option.default))
        elif option.kind == "number":
            made = ui.number(name, value=option.default).props("outlined dense")
        else:
            made = ui.input(name, value=option.default or "").props("outlined dense")
        made.on_value_change(lambda changed: self._values.__setitem__(option.name, changed.value))
        made.tooltip(option.about)

    async def _inject(self) -> None:
        missing = [each for each in self._options if each.required and self._values.get(each.name) in (None, "")]
        if missing:
            self._show(Answer(False, f"{missing[0].name.replace('_', ' ')}: required ({missing[0].about})"))
            return
        if self._for_s.value is not None and self._for_s.value <= 0.0:
            self._show(Answer(False, "For (s): must be greater than 0, or empty: until it is ended"))
            return
        words = words_of(self._options, self._values)
        await self._send(Order(self._train, self._unit.value or "", self._fault.value or "", words, self._for_s.value))

    async def _clear(self) -> None:
        await self._send(Order(self._train, self._unit.value or ""))

    async def _send(self, order: Order) -> None:
        self._answer.set_text("Asking the sensor.")
        answer = await run.io_bound(self._injecting.send, order)
        if answer is not None:
            self._show(answer)

    def _show(self, answer: Answer) -> None:
        self._answer.set_text(answer.text)
        self._answer.props(f'data-level="{"ok" if answer.done else "bad"}"')


def inject_panel(heard: Heard, train: str, injecting: Injecting) -> None:
    """Add the panel to the page; it appears when the train says that it allows it."""
    panel = _Panel(heard, train, injecting)
    ui.timer(ASK_EVERY_S, panel.look, immediate=True)
