"""Whatever is done to a rig file: a configuration that works, or a list of mistakes."""

from __future__ import annotations

import copy
import json
import math
import re

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from drivers import driver_class
from seod.config.check import check
from seod.config.load import ConfigErrors, load_text
from seod.config.model import RigConfig
from seod.config.token_field import WITH_TOKENS
from seod.config.yaml_lines import parse
from seod.files.shipped import configs_dir

EXAMPLES = [parse((configs_dir() / name).read_text()).value for name in ("virtual.yaml", "can.yaml")]
TEXT = (configs_dir() / "can.yaml").read_text()

values = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.floats(),
    st.sampled_from([0, -1, 1e300, 10**400, "5 V", "1 deg", "3 mm", "", "motor", "angle", "\x7f"]),
    st.text(max_size=5),
    st.just([]),
    st.just({}),
    st.lists(st.integers(-2, 2), max_size=3),
    st.dictionaries(st.text(max_size=3), st.none(), max_size=2),
)  # fmt: skip


def every_place(value: object, path: tuple[object, ...] = ()) -> list[tuple[object, ...]]:
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [place for key, item in items for place in [(*path, key), *every_place(item, (*path, key))]]


@st.composite
def mutated(draw) -> object:
    document = copy.deepcopy(draw(st.sampled_from(EXAMPLES)))
    for _ in range(draw(st.integers(1, 4))):
        *sections, last = draw(st.sampled_from(every_place(document)))
        holder = document
        for key in sections:
            holder = holder[key]
        action = draw(st.sampled_from(["change", "delete", "add", "copy"]))
        if action == "change":
            holder[last] = draw(values)
        elif action == "delete":
            del holder[last]
        elif action == "copy":
            holder[last] = copy.deepcopy(
                draw(st.sampled_from([document["axes"], document["driver"], "motor"]))
            )
        elif isinstance(holder, dict):
            holder[draw(st.sampled_from(["a", "channel", "simulation", "estop", "1"]))] = draw(values)
        if not all(key in document for key in ("axes", "driver")):
            break
    return document


def judge(text: str) -> RigConfig | None:
    """The configuration, known to work elsewhere; None if mistakes were found, each in a line of the file."""
    try:
        config = load_text(text, "x.yaml", configs_dir())
    except ConfigErrors as caught:
        mistakes = caught
    else:
        again = RigConfig.model_validate_json(config.model_dump_json(context=WITH_TOKENS))
        assert again == config
        driver_class(again.driver["kind"]).Options.model_validate(again.driver)
        assert str(check(config))
        return config
    assert mistakes.errors
    lines = len(re.split("\r\n|[\n\r\x85\u2028\u2029]", text))
    assert all(1 <= error.line <= lines and error.message for error in mistakes.errors)
    return None


def written(document: object) -> str:
    """As JSON, which is YAML; but YAML has other words for infinity and nan."""
    text = json.dumps(document, indent=1, ensure_ascii=False)
    return re.sub(
        r"(?<=[ \n])(-?)(Infinity|NaN)(?=[,\n])",
        lambda word: word[1] + {"I": ".inf", "N": ".nan"}[word[2][0]],
        text,
    )


@pytest.mark.parametrize("document", EXAMPLES, ids=["virtual", "can"])
def test_the_examples_stay_right_as_they_are_written_here(document: object) -> None:
    assert judge(written(document)) is not None


@pytest.mark.slow
@settings(max_examples=60, suppress_health_check=[HealthCheck.too_slow], deadline=None)
@given(mutated())
def test_no_mutation_of_an_example_crashes_the_loader(document: object) -> None:
    judge(written(document))


@pytest.mark.slow
@settings(max_examples=40, deadline=None)
@given(st.integers(0, len(TEXT)), st.integers(0, 40), st.text(max_size=6))
def test_no_damage_to_the_text_crashes_the_loader(at: int, length: int, inserted: str) -> None:
    judge(TEXT[:at] + inserted + TEXT[at + length :])


positive = st.floats(1e-3, 10.0)


@pytest.mark.slow
@settings(max_examples=40, deadline=None)
@given(
    rate=st.floats(100, 10_000),
    e_a=positive,
    bias=st.floats(-1, 1),
    amplitude=positive,
    hysteresis=st.floats(0, 0.999),
    K_L=st.floats(1e-6, 1e6),
    scale=st.floats(1e-3, 1e3),
    delay=st.floats(0, 0.1),
)
def test_generated_rigs_load_and_mean_what_they_say(
    rate: float,
    e_a: float,
    bias: float,
    amplitude: float,
    hysteresis: float,
    K_L: float,
    scale: float,
    delay: float,
) -> None:
    document = copy.deepcopy(EXAMPLES[0])
    axis = document["axes"]["motor"]
    document["loop"] = {"rate_hz": rate}
    document["sensors"]["angle"]["scale"] = scale
    axis["relay"] = {"e_a": e_a, "bias": bias, "hysteresis": hysteresis * amplitude}
    axis["limits"].update(output=e_a + 2, amplitude=amplitude, travel=[-2 * amplitude, 2 * amplitude])
    axis["polarity"] = {"movement": 0.1 * amplitude}
    axis["estimator"], axis["K_L"], axis["excitation"] = {"delay": delay}, K_L, {"kind": "burst"}
    document["guard"] = {"stale": "20 ms"}
    config = judge(written(document))
    assert config is not None
    found = config.axes["motor"]
    assert (found.relay.e_a, found.relay.bias, found.K_L, found.estimator.delay) == (e_a, bias, K_L, delay)
    assert (config.loop.rate_hz, config.sensors["angle"].scale) == (rate, scale)
    assert math.isclose(found.limits.travel[1], 2 * amplitude)
