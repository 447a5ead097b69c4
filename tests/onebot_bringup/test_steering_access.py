"""Who may talk to the steering server."""

import pytest

from onebot_bringup.serving.ports import is_loopback
from onebot_bringup.steering.access import Access, new_token

LOCAL = Access("", "127.0.0.1", 8080)
OPEN = Access("the token", "0.0.0.0", 8080)
ORIGIN = "http://127.0.0.1:8080"


@pytest.mark.parametrize("host", ["127.0.0.1:8080", "localhost:8080", "[::1]:9000", "LOCALHOST"])
def test_its_own_names_are_let_in_at_any_port(host):
    """A tunnel may lead to it from another port."""
    assert LOCAL.refusal(host, None, None, None) == ""
    assert LOCAL.refusal(host, f"http://{host}", None, None) == ""


@pytest.mark.parametrize(
    "host",
    ["evil.example", "evil.example:8080", "127.0.0.1.evil.example", "", "127.0.0.1:8080:1", "a b"],
)
def test_no_other_name_leads_to_loopback(host):
    """A foreign page whose name is made to lead here (DNS rebinding) is refused."""
    assert "open it as 127.0.0.1" in LOCAL.refusal(host, None, None, None)


@pytest.mark.parametrize(
    "origin",
    [
        "http://evil.example",
        "null",
        "",
        "http://127.0.0.1:8081",
        "https://127.0.0.1:8080",
        "http://127.0.0.1:8080.evil.example",
        "http://localhost:8080",
    ],
)
def test_foreign_origins_are_refused(origin):
    """Also another port of this host, another scheme, and with the right token."""
    assert "no access" in LOCAL.refusal("127.0.0.1:8080", origin, None, None)
    assert "no access" in OPEN.refusal("127.0.0.1:8080", origin, "the token", None)


def test_the_view_needs_its_own_frame_or_page():
    """Its opaque origin, or the page's under one of loopback's names; its key is the token."""
    for origin in (None, "null", ORIGIN, "http://localhost:8080"):
        assert LOCAL.view_refusal("127.0.0.1:8080", origin) == ""
        assert LOCAL.view_refusal("localhost:8080", origin) == ""
    assert OPEN.view_refusal("192.0.2.1:8080", "null") == ""
    for origin in ("http://evil.example", "http://localhost:8081", "http://[::1]:8080", ""):
        assert "no access" in LOCAL.view_refusal("127.0.0.1:8080", origin)
    assert "no access" in OPEN.view_refusal("192.0.2.1:8080", ORIGIN)
    assert "open it as" in LOCAL.view_refusal("evil.example:8080", "null")


@pytest.mark.parametrize("token", [None, "", "the toke", "the token ", "The token", "\udcff"])
def test_a_wrong_token_is_refused(token):
    """However near it is; and so is the token in the place of the cookie."""
    assert "token" in OPEN.refusal("robot:8080", None, token, None)
    assert "token" in OPEN.refusal("robot:8080", None, token, "the token")


def test_the_right_token_or_its_cookie_is_enough():
    """The cookie stands for the token without telling it; each token has its own."""
    assert OPEN.refusal("robot:8080", None, "the token", None) == ""
    assert OPEN.refusal("robot:8080", "http://robot:8080", None, OPEN.cookie) == ""
    assert "token" not in OPEN.cookie
    assert OPEN.cookie != Access("another", "0.0.0.0", 8080).cookie


def test_a_token_is_asked_for_on_loopback_too_if_there_is_one():
    """A host of several users may want it."""
    access = Access("secret", "127.0.0.1", 8080)
    assert access.refusal("127.0.0.1:8080", ORIGIN, None, None)
    assert not access.refusal("127.0.0.1:8080", ORIGIN, "secret", None)


def test_an_answer_repeats_nothing_dangerous():
    """A header that comes back in the sentence is no markup."""
    said = LOCAL.refusal("<script>alert(1)</script>", None, None, None)
    assert "<" not in said and ">" not in said


def test_new_tokens_differ_and_are_long():
    """128 bits, as text that an address can hold."""
    tokens = {new_token() for _ in range(100)}
    assert len(tokens) == 100 and all(len(token) >= 22 and token.isascii() for token in tokens)


@pytest.mark.parametrize(
    "address, loopback",
    [
        ("127.0.0.1", True),
        ("127.8.9.1", True),
        ("::1", True),
        ("localhost", True),
        ("0.0.0.0", False),
        ("::", False),
    ],
)
def test_loopback_is_known(address, loopback):
    """An address for all of the network is not."""
    assert is_loopback(address) is loopback
