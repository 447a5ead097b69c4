"""Where the steering page is served, and who may talk to its server."""

import pytest

from onebot_bringup.serving.ports import listen
from onebot_bringup.steering.access import Access, token_for
from onebot_description.errors import OneBotError

LOCAL = Access("", "127.0.0.1", 8080)
OPEN = Access("the token", "0.0.0.0", 8080)
ORIGIN = "http://127.0.0.1:8080"


@pytest.mark.parametrize("host", ["127.0.0.1:8080", "localhost:8080", "[::1]:9000", "LOCALHOST"])
def test_its_own_names_are_let_in_at_any_port(host):
    """A tunnel may lead to it from another port."""
    assert LOCAL.refusal(host, None, None, None) == ""
    assert LOCAL.refusal(host, f"http://{host}", None, None) == ""


@pytest.mark.parametrize(
    "host", ["evil.example:8080", "127.0.0.1.evil.example", "", "127.0.0.1:8080:1", "<b>"]
)
def test_no_other_name_leads_to_loopback(host):
    """A foreign page whose name is made to lead here (DNS rebinding); no markup is repeated."""
    refusal = LOCAL.refusal(host, None, None, None)
    assert "open it as 127.0.0.1" in refusal and "<" not in refusal
    assert "open it as" in LOCAL.view_refusal(host, "null")


@pytest.mark.parametrize(
    "origin",
    [
        "http://evil.example",
        "null",
        "",
        "http://127.0.0.1:8081",
        "https://127.0.0.1:8080",
        "http://127.0.0.1:8080.evil.example",
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


@pytest.mark.parametrize("token", [None, "", "the toke", "the token ", "The token", "\udcff"])
def test_a_wrong_token_is_refused(token):
    """However near it is; and so is the token in the place of the cookie."""
    assert "token" in OPEN.refusal("robot:8080", None, token, None)
    assert "token" in OPEN.refusal("robot:8080", None, token, "the token")


def test_the_right_token_or_its_cookie_is_enough():
    """The cookie stands for the token without telling it; on loopback it is asked for, too."""
    assert OPEN.refusal("robot:8080", None, "the token", None) == ""
    assert OPEN.refusal("robot:8080", "http://robot:8080", None, OPEN.cookie) == ""
    assert "token" not in OPEN.cookie
    assert OPEN.cookie != Access("another", "0.0.0.0", 8080).cookie
    local = Access("secret", "127.0.0.1", 8080)
    assert local.refusal("127.0.0.1:8080", ORIGIN, None, None)
    assert not local.refusal("127.0.0.1:8080", ORIGIN, "secret", None)


def test_a_token_is_made_where_other_computers_can_reach_the_page():
    """128 bits, as text that an address can hold; one that is given stays."""
    tokens = {token_for("0.0.0.0", "") for _ in range(10)} | {token_for("::", "")}
    assert len(tokens) == 11 and all(len(token) >= 22 and token.isascii() for token in tokens)
    assert token_for("127.8.9.1", "") == token_for("::1", "") == ""
    assert token_for("127.0.0.1", "mine") == token_for("0.0.0.0", "mine") == "mine"


@pytest.mark.parametrize("host", ["192.0.2.77", "no.such.host.invalid", "x" * 300])
def test_a_host_elsewhere_or_nowhere_is_refused(host):
    """With what would be right."""
    with pytest.raises(OneBotError, match="is not an address of this computer: write 127.0.0.1"):
        listen(host, 0)
