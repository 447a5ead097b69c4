"""Finds out which frame_prefix a robot was recorded with."""

from collections.abc import Collection


def frame_prefix_of(
    root: str, links: Collection[str], frames: Collection[str], namespace: str
) -> str:
    """Return what stands before the links' names in ``frames``.

    Args:
        root: the root link.
        links: all links, the root among them.
        frames: those that were recorded, of other robots too.
        namespace: the robot's; of several robots' prefixes that fit as well, the one named like it
            is taken.

    Returns:
        The prefix; "" where there is none, or no frame of the root link.
    """
    known = set(frames)
    found = {frame[: len(frame) - len(root)] for frame in known if frame.endswith(root)}

    def fit(prefix: str) -> tuple[int, bool, bool, int, str]:
        links_known = sum(prefix + link in known for link in links)
        named_so = prefix.strip("/_") == namespace.strip("/")
        return links_known, named_so, not prefix, -len(prefix), prefix

    return max(found, key=fit, default="")
