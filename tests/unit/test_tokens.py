"""Tokens: where they come from, who else may see them, and that nothing that is written shows them."""

from __future__ import annotations

import json
import os
import re

import pytest
import yaml
from hypothesis import example, given, settings
from hypothesis import strategies as st
from record_rows import Content
from test_cli import invoke

from seod.config.load import ConfigErrors, load_rig, load_text
from seod.config.model import RigConfig
from seod.config.redact import redacted, secrets
from seod.config.token_field import WITH_TOKENS
from seod.config.tokens import TokenError, client_token, read_token_file, with_tokens
from seod.files.shipped import configs_dir
from seod.gateway.server import ServerError, check_safe
from seod.record.opening import open_recorder

READ, COMMAND = "r34d-Nbq7XkZs1vLw", "c0mm4nd-Yt5RmPd2hGe"
VIRTUAL = (configs_dir() / "virtual.yaml").read_text()
RIG = VIRTUAL.replace("server:\n", f"server:\n  read_token: {READ}\n  command_token: '{COMMAND}'\n")


def rig(tmp_path, server="", text=VIRTUAL):
    """A rig file with these lines in its server section."""
    path = tmp_path / "rig.yaml"
    path.write_text(text.replace("server:\n", f"server:\n{server}"))
    return path


def token_file(tmp_path, token=COMMAND, mode=0o600, name="token"):
    path = tmp_path / name
    path.write_text(f"{token}\n")
    path.chmod(mode)
    return path


def tokens(config):
    server = with_tokens(config).server
    return [
        None if each is None else each.get_secret_value()
        for each in (server.read_token, server.command_token)
    ]


@pytest.fixture(autouse=True)
def bare_environment(monkeypatch):
    for name in (
        "SEOD_READ_TOKEN",
        "SEOD_COMMAND_TOKEN",
        "SEOD_TOKEN",
        "SEOD_TOKEN_FILE",
        "CREDENTIALS_DIRECTORY",
    ):
        monkeypatch.delenv(name, raising=False)


# Nothing that is written shows them


def test_a_configuration_is_written_without_its_tokens():
    config = load_text(RIG, "rig.yaml", configs_dir())
    for text in (config.model_dump_json(), str(config.model_dump()), repr(config), str(config.server)):
        assert READ not in text
        assert COMMAND not in text
    whole = RigConfig.model_validate_json(config.model_dump_json(context=WITH_TOKENS))
    assert tokens(whole) == [READ, COMMAND]


@pytest.mark.parametrize("name", ["a.mcap", "a.csv"])
def test_no_recording_shows_a_token(name, tmp_path):
    config = load_text(RIG, "rig.yaml", configs_dir())
    open_recorder(tmp_path / name, config, f"# command_token: {COMMAND}old\n{RIG}").close()
    data = (tmp_path / name).read_bytes()
    assert READ.encode() not in data
    assert COMMAND.encode() not in data
    if name == "a.mcap":
        content = Content(tmp_path / name)
        assert json.loads(content.attachments["rig.json"])["server"]["read_token"] == "x" * 16
        assert len(content.attachments["rig.yaml"]) == len(f"# command_token: {COMMAND}old\n{RIG}")


SPELLINGS = [
    "read_token: {0}",
    "read_token: '{0}'",
    'read_token: "{0}"',
    'read_token:   "{0}"  # not for you',
    "# read_token: {0}",
    "#read_token={0}",
    "server: {{read_token: {0}, port: 1}}",
    'server: {{"read_token":"{0}","port":1}}',
    "server:\n  read_token:\n    {0}",
    "server:\n  read_token: >-\n    {0}\n  port: 1",
    "a: &it {0}\nserver: {{read_token: *it}}",
    "read_token: {0}\nother: [unclosed",
    "read_token: {0}\n# it was {0} before",
    '{{"server": {{"command_token": "{0}"}}}}',
    "server:\r\n  command_token: {0}\r\n  port: 1\r\n",
    "- command_token: {0}\n- 2",
    "\ufeffread_token: {0}",
]


@pytest.mark.parametrize("spelling", SPELLINGS)
def test_a_token_is_taken_out_however_it_is_written(spelling):
    text = spelling.format(READ)
    told = redacted(text)
    assert READ not in told
    assert READ[:8] not in told
    assert len(told.encode()) == len(text.encode())
    assert secrets(told) == []
    assert redacted(told) == told


def parsed(text):
    try:
        return yaml.safe_load(text)
    except yaml.YAMLError:
        return None


SAFE = st.text(st.characters(codec="utf-8", exclude_categories=("Cs", "Cc")), min_size=16, max_size=40)


@given(SAFE, st.sampled_from(["json", "yaml", "flow"]), st.booleans())
@settings(max_examples=150, deadline=None)
@example("ä€𝄞" * 6, "json", True)
@example('"\\' * 8 + "'", "yaml", False)
def test_any_token_is_taken_out_of_any_file_and_nothing_else(token, form, ascii_only):
    rig = {"rig": "a", "server": {"port": 7600, "read_token": token, "tls": None}, "axes": {"m": [1, 2.5]}}
    if form == "json":
        text = json.dumps(rig, ensure_ascii=ascii_only)
    else:
        text = yaml.safe_dump(rig, allow_unicode=not ascii_only, default_flow_style=form == "flow")
    told = redacted(text)
    assert len(told.encode()) == len(text.encode())
    again = yaml.safe_load(told) if parsed(text) else None
    if again is not None:
        hidden = again["server"].pop("read_token")
        assert set(str(hidden)) <= {"x", " ", "\n"}
        assert again == {**rig, "server": {"port": 7600, "tls": None}}


@pytest.mark.slow
def test_messages_do_not_quote_tokens(tmp_path):
    wrong = (
        f"  - read_token: {READ}\n",
        f"  read_token: [{READ}]\n",
        f"  read_token: {{a: {READ}}}\n",
        f"  read_token: {READ[:10]}\n",
        f'  read_token: "{READ}\\ud800"\n',
        f"  read_token: {READ}\n  read_token: {READ}\n",
        f"  read_token: {READ}\n  command_token: {READ}\n",
        f"  read_token: {READ}: b\n",
        f"  tls: {{read_token: {READ}}}\n",
    )
    for server in wrong:
        code, out, err = invoke("check", rig(tmp_path, server))
        assert code == 1, server
        assert READ[:10] not in out + err, server
    assert READ[:10] not in invoke("check", rig(tmp_path, "", f"server: [{{read_token: {READ}}}]\n"))[2]


def test_what_a_recording_holds_in_the_place_of_a_token_is_no_token(tmp_path):
    text = redacted(RIG)
    with pytest.raises(ConfigErrors) as caught:
        load_text(text, "rig.yaml", tmp_path)
    assert [error.key for error in caught.value.errors] == ["server.read_token", "server.command_token"]
    assert "stands where a recording does not show a token" in str(caught.value)
    config = load_text(RIG, "rig.yaml", tmp_path)
    with pytest.raises(ServerError, match=r"server\.read_token: the token itself did not come"):
        check_safe(RigConfig.model_validate_json(config.model_dump_json()).server)
    filled = token_file(tmp_path, "x" * 20)
    with pytest.raises(TokenError, match="not a token"):
        read_token_file(filled)


# Where they come from


def test_tokens_by_file(tmp_path):
    token_file(tmp_path, READ, name="read")
    token_file(tmp_path, COMMAND, 0o640, name="command")
    config = load_rig(rig(tmp_path, "  read_token_file: read\n  command_token_file: ./command\n"))
    assert config.server.read_token is None
    assert tokens(config) == [READ, COMMAND]
    with pytest.raises(ServerError, match="did not come with the configuration"):
        check_safe(config.server)  # a gateway that was not given them lets nobody in


def test_tokens_by_environment(tmp_path, monkeypatch):
    config = load_rig(rig(tmp_path))
    monkeypatch.setenv("SEOD_COMMAND_TOKEN", COMMAND)
    assert tokens(config) == [None, COMMAND]
    with pytest.raises(TokenError, match=r"SEOD_COMMAND_TOKEN: .*command_token already"):
        with_tokens(load_rig(rig(tmp_path, f"  command_token: {COMMAND}\n")))
    monkeypatch.setenv("SEOD_COMMAND_TOKEN", "short")
    with pytest.raises(TokenError, match="SEOD_COMMAND_TOKEN: must hold one line"):
        with_tokens(config)


def test_tokens_by_credentials(tmp_path, monkeypatch):
    path = rig(tmp_path, "  command_token_file: $CREDENTIALS_DIRECTORY/command_token\n")
    config = load_rig(path)  # loads without them, for whoever wants to look at it
    with pytest.raises(TokenError, match="only the systemd unit has it"):
        with_tokens(config)
    (tmp_path / "credentials").mkdir()
    monkeypatch.setenv("CREDENTIALS_DIRECTORY", str(tmp_path / "credentials"))
    with pytest.raises(ConfigErrors, match=r"command_token_file: .*credentials/command_token cannot be read"):
        load_rig(path)
    token_file(tmp_path / "credentials", name="command_token", mode=0o400)
    assert tokens(load_rig(path)) == [None, COMMAND]


def test_the_same_token_for_both_rights_is_refused_wherever_it_comes_from(tmp_path, monkeypatch):
    monkeypatch.setenv("SEOD_READ_TOKEN", COMMAND)
    token_file(tmp_path)
    with pytest.raises(TokenError, match="must differ"):
        with_tokens(load_rig(rig(tmp_path, "  command_token_file: token\n")))


def test_a_token_given_twice_is_told(tmp_path):
    token_file(tmp_path)
    with pytest.raises(ConfigErrors, match=r"server\.command_token: is in command_token_file too"):
        load_rig(rig(tmp_path, f"  command_token: {COMMAND}\n  command_token_file: token\n"))


def test_other_machines_are_let_in_with_tokens_from_anywhere(tmp_path, monkeypatch):
    for name in ("cert.pem", "key.pem"):
        token_file(tmp_path, name=name)
    token_file(tmp_path)
    text = VIRTUAL.replace("host: 127.0.0.1", "host: 0.0.0.0")
    server = "  tls: {certificate: cert.pem, key: key.pem}\n  command_token_file: token\n"
    with pytest.raises(ConfigErrors, match="which needs read_token;"):
        load_rig(rig(tmp_path, server, text))
    monkeypatch.setenv("SEOD_READ_TOKEN", READ)
    assert tokens(load_rig(rig(tmp_path, server, text))) == [READ, COMMAND]


# Who may see a token's file


@pytest.mark.parametrize("mode", [0o600, 0o400, 0o440, 0o640])
def test_a_private_token_file_is_read(mode, tmp_path):
    assert read_token_file(token_file(tmp_path, mode=mode)) == COMMAND


@pytest.mark.parametrize(
    ("mode", "why"),
    [
        (0o644, "can be read by everyone"),
        (0o604, "can be read by everyone"),
        (0o602, "can be changed by everyone"),
        (0o660, "can be changed by its group"),
        (0o777, "can be changed by everyone"),
    ],
)
def test_a_token_file_that_others_may_use_is_refused(mode, why, tmp_path):
    path = token_file(tmp_path, mode=mode)
    with pytest.raises(TokenError, match=re.escape(f"{path}: {why} (mode {mode:04o}); right would be 0600")):
        read_token_file(path)


@pytest.mark.parametrize("content", ["", "short\n", "two lines of it\nand more", "\0" * 20, b"\xff" * 20])
def test_a_file_that_holds_no_token_is_refused_without_a_word_of_it(content, tmp_path):
    path = token_file(tmp_path)
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(
        TokenError, match="must hold one line of UTF-8 text, at least 16 characters"
    ) as caught:
        read_token_file(path)
    assert "short" not in str(caught.value)


def test_a_token_file_that_is_none_is_refused(tmp_path):
    with pytest.raises(TokenError, match="No such file"):
        read_token_file(tmp_path / "none")
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(TokenError, match="is a pipe, not a file"):
        read_token_file(tmp_path / "pipe")


def test_a_missing_token_file_is_told_with_its_line(tmp_path):
    code, _, err = invoke("check", rig(tmp_path, "  command_token_file: none\n"))
    assert code == 1
    assert re.search(r"rig\.yaml:\d+: server\.command_token_file: .*none cannot be read: No such file", err)


# Clients


def test_a_clients_token(tmp_path, monkeypatch):
    config = load_rig(rig(tmp_path, f"  read_token: {READ}\n"))
    assert client_token(config) == READ
    assert client_token(load_rig(rig(tmp_path))) is None
    monkeypatch.setenv("SEOD_TOKEN_FILE", str(token_file(tmp_path)))
    assert client_token(config) == COMMAND
    monkeypatch.setenv("SEOD_TOKEN", "t")
    assert client_token(config) == "t"


def test_a_client_refuses_a_token_file_that_others_can_read(tmp_path):
    path = token_file(tmp_path, mode=0o644)
    assert invoke("status", "--token-file", path) == (
        1,
        "",
        f"seod: {path}: can be read by everyone (mode 0644); right would be 0600, or 0640\n",
    )


# What `seod check` says of files that others can read


def check_says(path):
    code, out, _ = invoke("check", path)
    return code, [line for line in out.splitlines() if line.startswith(("warning", "refused"))]


def test_check_warns_of_a_rig_file_with_tokens_that_others_can_read(tmp_path):
    path = rig(tmp_path, f"  read_token: {READ}\n  command_token: {COMMAND}\n")
    path.chmod(0o644)
    told = f"warning: {path} holds read_token and command_token and can be read by everyone (mode 0644)"
    assert check_says(path) == (
        0,
        [f"{told}; right would be 0600, or 0640; better still, read_token_file and command_token_file"],
    )
    path.chmod(0o640)
    assert check_says(path) == (0, [])


def test_check_warns_of_a_rig_file_that_others_can_change(tmp_path):
    path = rig(tmp_path)
    path.chmod(0o644)
    assert check_says(path) == (0, [])
    path.chmod(0o646)
    code, (said,) = check_says(path)
    assert code == 0
    assert "can be changed by everyone (mode 0646)" in said
    assert said.endswith("whoever changes it changes the limits of the machine")


def test_check_warns_of_a_key_and_refuses_a_token_that_others_can_read(tmp_path):
    for name in ("cert.pem", "key.pem"):
        token_file(tmp_path, name=name, mode=0o644)
    token_file(tmp_path, mode=0o644)
    server = "  tls: {certificate: cert.pem, key: key.pem}\n  command_token_file: token\n"
    path = rig(tmp_path, server)
    why = "can be read by everyone (mode 0644); right would be 0600, or 0640"
    assert check_says(path) == (
        1,
        [
            f"refused: server.command_token_file: {tmp_path}/token {why}",
            f"warning: server.tls.key: {tmp_path}/key.pem {why}",
        ],
    )
    (tmp_path / "key.pem").chmod(0o600)
    (tmp_path / "token").chmod(0o600)
    assert check_says(path) == (0, [])


# Copies of a rig file


def test_the_extended_rig_has_no_token(tmp_path):
    from seod.diagnose.extend.references import moved

    for name in ("cert.pem", "key.pem"):
        token_file(tmp_path, name=name)
    token_file(tmp_path, READ)
    server = (
        f"  command_token: {COMMAND}  # {COMMAND}\n  read_token_file: token\n"
        "  tls: {certificate: cert.pem, key: key.pem}\n"
    )
    path = rig(tmp_path, server, VIRTUAL.replace("host: 127.0.0.1", "host: 0.0.0.0"))
    text = moved(path.read_text(), load_rig(path), path, tmp_path / "found")
    assert COMMAND not in text
    there = load_text(text, "extended", tmp_path / "found").server
    assert (there.host, there.command_token) == ("127.0.0.1", None)
    assert there.read_token_file == str(tmp_path / "token")


def test_the_difference_that_a_calibration_shows_has_no_token(tmp_path, monkeypatch, capsys):
    from seod.calibrate import shell

    path = rig(tmp_path, f"  read_token: {READ}\n")
    config = load_rig(path)
    monkeypatch.setattr(shell, "measure", lambda *_: {"motor": {}})
    monkeypatch.setattr(shell, "changes", lambda *_: {("server", "port"): 7601, ("server", "host"): "::1"})
    monkeypatch.setattr(shell, "as_text", lambda *_: "")
    shell.calibrate(config, path, ["motor"], 1, shell.Options(dry_run=True, yes=True, as_json=False))
    said = capsys.readouterr()
    assert "read_token: xxx" in said.out
    assert READ not in said.out + said.err
