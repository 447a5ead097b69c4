"""Where the steering page is served, settled before anything is started."""

import pytest

from onebot_bringup.serving.ports import listen
from onebot_bringup.steering.access import choose_bind_address
from onebot_description.errors import OneBotError


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "0.0.0.0", ""])
def test_an_address_of_this_computer_can_be_listened_on(host):
    """All of them, too; any port will do for 0, and that it is another one needs no word."""
    found = choose_bind_address(host, 0, "")
    assert found.host == host and found.port > 0 and found.warning == ""


@pytest.mark.parametrize("host", ["192.0.2.77", "no.such.host.invalid", "a b", "x" * 300])
def test_a_host_elsewhere_or_nowhere_is_found_out_beforehand(host):
    """With what would be right."""
    with pytest.raises(OneBotError, match="is not an address of this computer: write 127.0.0.1"):
        choose_bind_address(host, 0, "")


def test_a_token_is_made_where_one_is_needed():
    """A given one stays, and on loopback there need not be one."""
    assert choose_bind_address("127.0.0.1", 0, "").token == ""
    assert choose_bind_address("127.0.0.1", 0, "mine").token == "mine"
    assert choose_bind_address("0.0.0.0", 0, "mine").token == "mine"
    made = [choose_bind_address("0.0.0.0", 0, "").token for _ in range(2)]
    assert len(set(made)) == 2 and min(map(len, made)) > 16


def test_a_port_in_use_gives_way_to_another_one():
    """It says so; the port is the node's parameter, for its later starts, too."""
    with listen("127.0.0.1", 0) as other:
        used = other.getsockname()[1]
        found = choose_bind_address("127.0.0.1", used, "")
    assert found.port not in (0, used)
    assert found.warning == f"port {used} is in use; using {found.port} instead"
    assert found.parameters == {"host": "127.0.0.1", "port": found.port, "token": ""}
