"""Chains of mimic joints: how each joint follows the one at the beginning of its chain."""

from collections.abc import Iterable, Mapping

from onebot_description.elements.urdf import Mimic


def followers(
    joints: Iterable[str], mimics: Mapping[str, Mimic], given: Iterable[str]
) -> dict[str, Mimic]:
    """Reduce chains of mimic joints.

    Args:
        joints: names of joints.
        mimics: how joints follow the next one of their chain; there is no circle.
        given: the joints that have a position of their own, even if they are in ``mimics``.

    Returns:
        For each of ``joints`` how it follows one of the given joints, which may be the joint
        itself. Joints that follow none of them are left out.
    """
    mimic_by_joint = {name: Mimic(name) for name in given}
    reduced = {}
    for joint in joints:
        chain, name = [], joint
        while name not in mimic_by_joint and name in mimics:
            chain.append(name)
            name = mimics[name].joint
        if name not in mimic_by_joint:
            continue
        for follower in reversed(chain):
            mimic_by_joint[follower] = mimics[follower].after(mimic_by_joint[name])
            name = follower
        reduced[joint] = mimic_by_joint[joint]
    return reduced
