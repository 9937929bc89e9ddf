import json
import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seod.gateway.params import AxisParams, EstopParams, Params, SetParams, SubscribeParams, read_params
from seod.protocol.jsonrpc import (
    INVALID_PARAMS,
    INVALID_REQUEST,
    MAX_BATCH,
    PARSE_ERROR,
    LineSplitter,
    LineTooLongError,
    Refusal,
    Request,
    RpcError,
    error_text,
    notification,
    parse,
    result_text,
    unknown_method,
)

LIMIT = 40


def split(chunks):
    """Lines, and None where one was too long."""
    splitter, found = LineSplitter(LIMIT), []
    for chunk in chunks:
        splitter.feed(chunk)
        while True:
            try:
                line = splitter.next_line()
            except LineTooLongError:
                found.append(None)
                continue
            if line is None:
                break
            found.append(line)
    return found


def only(line):
    (request,) = parse(line).requests
    return request


@given(st.lists(st.binary(max_size=100)), st.lists(st.integers(1, 60)))
def test_lines_do_not_depend_on_how_the_bytes_arrive(lines, cuts):
    stream = b"\n".join(line.replace(b"\n", b"") for line in lines) + b"\n"
    chunks, rest = [], stream
    for cut in cuts:
        chunks.append(rest[:cut])
        rest = rest[cut:]
    expected = [line if len(line) <= LIMIT else None for line in stream.split(b"\n")[:-1]]
    assert split([*chunks, rest]) == expected


def test_a_line_without_end_does_not_grow():
    splitter = LineSplitter(LIMIT)
    splitter.feed(b"x" * (LIMIT + 1))
    with pytest.raises(LineTooLongError):
        splitter.next_line()
    for _ in range(1000):
        splitter.feed(b"x" * 10)
        assert splitter.next_line() is None
    assert len(splitter._buffer) <= LIMIT
    splitter.feed(b"\ngood\n")
    assert splitter.next_line() == b"good"


WORDS = st.text(max_size=8)
JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | WORDS,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(WORDS, inner, max_size=3),
    max_leaves=4,
)
REQUEST_LIKE = st.fixed_dictionaries(
    {},
    optional={
        "jsonrpc": st.just("2.0") | JSON,
        "method": WORDS | JSON,
        "id": JSON,
        "params": st.dictionaries(WORDS, JSON, max_size=3) | JSON,
    },
)


@given(st.binary())
def test_any_bytes_are_requests_or_refusals(line):
    for request in parse(line).requests:
        assert isinstance(request, (Request, Refusal))


def usable_id(message):
    sent = message.get("id") if isinstance(message, dict) else None
    return sent if isinstance(sent, (str, int, float)) and not isinstance(sent, bool) else None


@settings(max_examples=50)
@given(REQUEST_LIKE | st.lists(REQUEST_LIKE, min_size=1, max_size=4))
def test_every_request_with_a_usable_id_keeps_it(message):
    call = parse(json.dumps(message).encode())
    assert call.batch == isinstance(message, list)
    sent = message if call.batch else [message]
    assert [request.id for request in call.requests] == [usable_id(each) for each in sent]
    for request in call.requests:
        error_text(request.id, RpcError(0, "x"))


def test_a_batch_is_not_too_long():
    one = b'{"jsonrpc":"2.0","id":1,"method":"info"}'
    assert len(parse(b"[" + b",".join([one] * MAX_BATCH) + b"]").requests) == MAX_BATCH
    call = parse(b"[" + b",".join([one] * (MAX_BATCH + 1)) + b"]")
    assert not call.batch
    assert isinstance(call.requests[0], Refusal)


@settings(max_examples=50)
@given(REQUEST_LIKE)
def test_parameters_of_any_kind_are_taken_or_refused(message):
    request = only(json.dumps(message).encode())
    if not isinstance(request, Request):
        return
    for model in (Params, AxisParams, SetParams, SubscribeParams, EstopParams):
        try:
            read_params(model, request.params)
        except RpcError as error:
            assert error.code == INVALID_PARAMS  # noqa: PT017 - it may, but need not be raised
            error_text(request.id, error)


@pytest.mark.parametrize(
    ("line", "code"),
    [
        (b"{", PARSE_ERROR),
        (b"\xff\xfe", PARSE_ERROR),
        (b"[" * 60000, PARSE_ERROR),
        (b'{"jsonrpc":"2.0","id":1,"method":"info","params":{"x":NaN}}', PARSE_ERROR),
        (b'{"jsonrpc":"2.0","id":' + b"9" * 5000 + b',"method":"info"}', PARSE_ERROR),
        (b"7", INVALID_REQUEST),
        (b"[]", INVALID_REQUEST),
        (b'{"jsonrpc":"2.0","id":true,"method":"info"}', INVALID_REQUEST),
        (b'{"jsonrpc":"2.0","id":1e999,"method":"info"}', INVALID_REQUEST),
        (b'{"id":1,"method":"info"}', INVALID_REQUEST),
        (b'{"jsonrpc":"2.0","id":1,"method":5}', INVALID_REQUEST),
        (b'{"jsonrpc":"2.0","id":1,"result":{}}', INVALID_REQUEST),
    ],
)
def test_what_is_no_request_is_refused(line, code):
    request = only(line)
    assert isinstance(request, Refusal)
    assert request.error.code == code


def test_empty_lines_ask_for_nothing():
    assert parse(b"").requests == parse(b"\r").requests == ()


def test_a_request_without_id_is_not_answered():
    assert not only(b'{"jsonrpc":"2.0","method":"stop"}').answered
    assert only(b'{"jsonrpc":"2.0","id":null,"method":"stop"}').answered


def test_undefined_numbers_become_null():
    sent = json.loads(notification("sample", {"y": math.nan, "list": [math.inf, 1.5], "n": {"x": -math.inf}}))
    assert sent == {
        "jsonrpc": "2.0",
        "method": "sample",
        "params": {"y": None, "list": [None, 1.5], "n": {"x": None}},
    }


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_numbers_keep_all_their_digits(x):
    assert json.loads(result_text(1, x))["result"] == x


@settings(max_examples=50)
@given(JSON)
def test_a_message_is_one_line(value):
    line = result_text("id", value).encode() + b"\n"
    assert line.endswith(b"\n")
    assert line.count(b"\n") == 1


def refusal(model, params):
    with pytest.raises(RpcError) as error:
        read_params(model, params)
    assert error.value.code == INVALID_PARAMS
    return str(error.value)


def test_wrong_parameters_are_named_with_what_would_be_right():
    assert refusal(SetParams, {"e_a": -1}) == "e_a: should be greater than 0, got -1"
    assert "e_a: should be a valid number, got True" in refusal(SetParams, {"e_a": True})
    assert "e_a: should be a valid number, got '1'" in refusal(SetParams, {"e_a": "1"})
    assert "did you mean hysteresis?" in refusal(SetParams, {"hysterisis": 1})
    assert "topics: required" in refusal(SubscribeParams, {})
    assert "'estimate', 'sample'" in refusal(SubscribeParams, {"topics": ["estimates"]})
    assert "rate_hz: should be a finite number" in refusal(
        SubscribeParams, {"topics": ["event"], "rate_hz": math.inf}
    )
    assert "by name" in refusal(SetParams, [1])


def test_all_wrong_parameters_are_told_at_once():
    told = refusal(SetParams, {"e_a": 0, "bias": "x", "foo": 1})
    assert told.count(";") >= 2


def test_an_estop_is_never_refused_for_its_parameters():
    assert read_params(EstopParams, {"axis": 7, "now": True}) == EstopParams()


def test_an_unknown_method_is_answered_with_close_names():
    assert "did you mean subscribe" in unknown_method("subscibe", ["subscribe", "status", "get"]).message
    assert "known: get, status" in unknown_method("qqq", ["status", "get"]).message
