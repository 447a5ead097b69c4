"""Links and joints must make one tree: one root, one parent each, no loop."""

from collections.abc import Mapping

from onebot_description.description.report import Element, Report
from onebot_description.text import did_you_mean, listing


def read_ends(
    report: Report, joints: Mapping[str, Element], links: Mapping[str, Element]
) -> dict[str, tuple[str, str]]:
    """Return the parent and child link of each joint whose ends are both known links."""
    ends = {}
    for name, joint in joints.items():
        parent = _read_end(report, joint, "parent", links)
        child = _read_end(report, joint, "child", links)
        if parent is not None and child is not None:
            if parent == child:
                report.problem(
                    joint, f'connects link "{parent}" with itself; parent or child is wrong'
                )
            else:
                ends[name] = (parent, child)
    return ends


def _read_end(report: Report, joint: Element, end: str, links: Mapping[str, Element]) -> str | None:
    element = joint.find(end)
    if element is None:
        report.problem(joint, f'has no <{end}>; write <{end} link="..."/>')
        return None
    link = element.get("link")
    if not link:
        report.problem(element, f'names no link; write <{end} link="..."/>')
        return None
    if link not in links:
        hint = did_you_mean(link, links, "links")
        report.problem(element, f'there is no link "{link}"{hint}')
        return None
    return link


def check_tree(
    report: Report,
    joints: Mapping[str, Element],
    links: Mapping[str, Element],
    ends: Mapping[str, tuple[str, str]],
) -> str:
    """Report what keeps the links from being one tree.

    Args:
        report: takes the problems.
        joints: the joint elements by name.
        links: the link elements by name.
        ends: parent and child link of each joint.

    Returns:
        The root link; "" if that cannot be said.
    """
    if not links:
        report.problem(
            report.document.root, 'has no links; write at least <link name="base_link"/>'
        )
        return ""
    above: dict[str, str] = {}  # child link -> the joint that moves it
    for joint, (_, child) in ends.items():
        if child in above:
            report.problem(
                joints[joint],
                f'link "{child}" has two parents: joint "{above[child]}" moves it already; '
                "a link hangs on one joint",
            )
        else:
            above[child] = joint
    parents = {child: ends[joint][0] for child, joint in above.items()}
    for loop in _loops(parents):
        names = " -> ".join([*loop, loop[0]])
        report.problem(
            joints[above[loop[0]]], f"the links {names} form a loop; remove one of its joints"
        )
    roots = [link for link in links if link not in parents]
    # A joint that could not be read may well be the missing connection.
    if len(roots) > 1 and len(ends) == len(report.document.root.findall("joint")):
        report.problem(
            links[roots[1]],
            f"the robot falls into {len(roots)} parts, whose roots are {listing(roots)}; "
            f'connect each with a joint, so that only "{roots[0]}" has no parent',
        )
    return roots[0] if len(roots) == 1 else ""


def _loops(parents: Mapping[str, str]) -> list[list[str]]:
    """The cycles in a map of child to parent, each from parent to child."""
    loops = []
    done: set[str] = set()
    for start in parents:
        path: list[str] = []
        on_path: set[str] = set()
        link = start
        while link in parents and link not in done and link not in on_path:
            path.append(link)
            on_path.add(link)
            link = parents[link]
        if link in on_path:
            loops.append(path[path.index(link) :][::-1])
        done.update(path)
    return loops
