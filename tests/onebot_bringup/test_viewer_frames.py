import numpy as np

from onebot_bringup.viewer.frames import FrameTree

QUARTER_TURN = np.array([0, 0, np.sqrt(0.5), np.sqrt(0.5)])  # about z
NO_TURN = np.array([0.0, 0.0, 0.0, 1.0])


def _tree() -> FrameTree:
    tree = FrameTree()
    tree.update(
        ["odom", "base", "base"],
        ["base", "arm", "wheel"],
        np.array([[1.0, 0, 0], [0, 2, 0], [0, 0, 3]]),
        np.array([QUARTER_TURN, NO_TURN, NO_TURN]),
    )
    return tree


def test_the_top_frame_is_the_one_above_all():
    """Every frame leads to odom; an unknown one is its own top."""
    tree = _tree()
    assert {tree.top(name) for name in tree.names} == {"odom"}
    assert tree.top("elsewhere") == "elsewhere"


def test_poses_chain_transforms():
    """A point 2 m along y of a base turned by a quarter lies at x = 1 - 2."""
    tree = _tree()
    np.testing.assert_allclose(tree.pose("arm", "odom")[:3, 3], [-1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(tree.pose("wheel", "arm")[:3, 3], [0, -2, 3], atol=1e-12)
    assert tree.pose("elsewhere", "odom") is None
    assert set(tree.poses(["arm", "elsewhere"], "base")) == {"arm"}


def test_a_loop_of_frames_ends():
    """Nonsense on /tf must not hang the viewer."""
    tree = FrameTree()
    tree.update(["b", "a"], ["a", "b"], np.zeros((2, 3)), np.array([NO_TURN, NO_TURN]))
    assert tree.top("a") in ("a", "b")


def test_forgotten_frames_are_gone_until_heard_again():
    """Frames of a removed link vanish."""
    tree = _tree()
    tree.forget(["arm", "never"])
    assert tree.names == {"odom", "base", "wheel"}
    tree.update(["base"], ["arm"], np.zeros((1, 3)), NO_TURN[None])
    assert "arm" in tree.names


def test_the_same_lists_of_names_again_only_move_the_frames():
    """Poses follow, and nothing says that what hangs on what has changed."""
    tree, parents, children = FrameTree(), ["a", "b"], ["b", "c"]
    turns = np.tile([0.0, 0.0, 0.0, 1.0], (2, 1))
    tree.update(parents, children, np.array([[1.0, 0, 0], [2.0, 0, 0]]), turns)
    version = tree.version
    tree.update(parents, children, np.array([[3.0, 0, 0], [4.0, 0, 0]]), turns)
    assert tree.version == version
    assert tree.pose("c", "a")[0, 3] == 7.0


def test_another_message_on_a_frame_counts_and_so_does_the_next_of_the_first():
    """The last word on each frame holds, whoever says it; hanging elsewhere is a change."""
    tree, parents, children = FrameTree(), ["a", "b"], ["b", "c"]
    turns = np.tile([0.0, 0.0, 0.0, 1.0], (2, 1))
    both = np.array([[1.0, 0, 0], [2.0, 0, 0]])
    tree.update(parents, children, both, turns)
    version = tree.version
    tree.update(["x"], ["c"], np.array([[9.0, 0, 0]]), turns[:1])
    assert tree.version != version and tree.top("c") == "x"
    tree.update(parents, children, both, turns)
    assert tree.top("c") == "a" and tree.pose("c", "a")[0, 3] == 3.0
    tree.forget(["b"])
    assert tree.top("c") == "b" and tree.names == {"b", "c"}
    tree.update(parents, children, both, turns)
    assert tree.top("c") == "a" and tree.names == {"a", "b", "c"}
