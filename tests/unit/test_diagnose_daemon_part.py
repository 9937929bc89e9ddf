"""What of a daemon's recording is diagnosed: the changed rig, else the excited one."""

from __future__ import annotations

import json
import math

import pytest
from mcap.writer import Writer

from seod.diagnose.record.daemon_part import telling_part
from seod.record.layout import EVENTS, MODEL_ERRORS, PROFILE


@pytest.fixture
def recording(tmp_path):
    """Writes a recording of messages (topic, content)."""

    def write(*messages, axes=("motor",)):
        path = tmp_path / "run.mcap"
        with path.open("wb") as stream:
            writer = Writer(stream)
            writer.start()
            writer.add_metadata(PROFILE, {"axes": json.dumps(axes), "started": "now"})
            channels = {
                topic: writer.register_channel(topic, "json", 0) for topic in {one for one, _ in messages}
            }
            for topic, content in messages:
                writer.add_message(channels[topic], 0, json.dumps(content).encode(), 0)
            writer.finish()
        return path

    return write


def state(t, name, axis="motor"):
    return EVENTS, {"event": "state", "t": t, "axis": axis, "state": name}


def error(t, left, axis="motor"):
    return MODEL_ERRORS + axis, {"axis": axis, "t": t, "left": left}


def test_the_longest_excitation(recording):
    path = recording(
        state(1.0, "idle"),
        state(2.0, "exciting"),
        state(6.5, "holding"),
        state(7.0, "exciting"),
        state(17.0, "fault"),
        state(20.0, "exciting", "roll"),
        state(21.0, "exciting"),
        state(24.0, "idle"),
    )
    assert telling_part(path, None) == (7.0, 17.0, "the rig was excited")


def test_an_excitation_that_never_ends(recording):
    assert telling_part(recording(state(2.0, "armed"), state(3.0, "exciting")), None)[:2] == (3.0, math.inf)


def test_a_rig_that_left_its_model_goes_first(recording):
    course = [(k, 10 <= k < 15 or 20 <= k < 26) for k in range(40)]
    path = recording(state(0.0, "exciting"), *(error(float(k), left) for k, left in course))
    assert telling_part(path, None) == (20.0, 26.0, "the rig had left its model")


def test_not_for_a_moment(recording):
    path = recording(state(0.0, "exciting"), *(error(0.3 * k, 5 < k < 12) for k in range(40)))
    assert telling_part(path, None).why == "the rig was excited"


def test_of_the_axis_that_is_asked_for(recording):
    messages = state(1.0, "exciting", "roll"), state(9.0, "idle", "roll"), state(5.0, "exciting", "pitch")
    path = recording(*messages, axes=("pitch", "roll"))
    assert telling_part(path, "roll")[:2] == (1.0, 9.0)
    assert telling_part(path, None)[:2] == (5.0, math.inf)


@pytest.mark.parametrize("content", [b"", b"t,u,y\n0,0,0\n", b"\x89MCAP0\r\n"])
def test_recordings_of_others_are_taken_whole(tmp_path, content):
    path = tmp_path / "other.mcap"
    path.write_bytes(content)
    assert telling_part(path, None) is None


def test_one_that_was_never_excited_is_taken_whole(recording):
    assert telling_part(recording(state(1.0, "idle"), state(9.0, "armed")), None) is None
