"""Names of frames with diff_drive_controller's prefix."""

import pytest

from onebot_control.conventions import namespace_prefix, prefixed


@pytest.mark.parametrize(
    ("enabled", "prefix", "namespace", "expected"),
    [
        (False, "", "/", "odom"),
        (False, "test_prefix", "/test_namespace", "odom"),
        (True, "test_prefix", "/", "test_prefix/odom"),
        (True, "test_prefix", "/test_namespace", "test_prefix/odom"),
        (True, "", "/", "odom"),
        (True, "", "/test_namespace", "test_namespace/odom"),
        (True, "/test_prefix/", "/", "test_prefix/odom"),
        (True, "/", "/test_namespace", "odom"),
        (True, "~", "/a/b", "a/b/odom"),
        (True, "~", "/", "odom"),
        (True, "//a//", "/", "/a//odom"),
    ],
)
def test_prefix(enabled: bool, prefix: str, namespace: str, expected: str) -> None:
    """diff_drive_controller's cases: off, given, or the namespace; slashes made right."""
    assert prefixed("odom", enabled, prefix, namespace) == expected
    assert namespace_prefix("/test_namespace") == "test_namespace/"
