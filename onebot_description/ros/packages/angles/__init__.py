"""Arithmetic of angles, rad, as in the package angles."""

from math import fabs, fmod, pi

_TURN = 2.0 * pi


def normalize_angle_positive(angle: float) -> float:
    """Return an angle wrapped to 0 to 2 pi."""
    return angle % _TURN


def normalize_angle(angle: float) -> float:
    """Return an angle wrapped to -pi, exclusive, to pi."""
    positive = normalize_angle_positive(angle)
    return positive - _TURN if positive > pi else positive


def shortest_angular_distance(from_angle: float, to_angle: float) -> float:
    """Return the shortest turn from one angle to another, from -pi to pi."""
    return normalize_angle(to_angle - from_angle)


def two_pi_complement(angle: float) -> float:
    """Return the turn to the same direction the other way round, from -2 pi to 2 pi."""
    angle = angle if -_TURN <= angle <= _TURN else fmod(angle, _TURN)
    return angle - _TURN if angle > 0 else angle + _TURN


def shortest_angular_distance_with_limits(
    from_angle: float, to_angle: float, left_limit: float, right_limit: float
) -> tuple[bool, float]:
    """Return whether a turn stays within limits, and the turn.

    Args:
        from_angle: where it begins.
        to_angle: where it ends.
        left_limit: where the valid interval begins, from -pi to pi.
        right_limit: where it ends, counterclockwise; it may contain pi.
    """
    begins_inside, lower, upper = _find_min_max_delta(from_angle, left_limit, right_limit)
    turn = shortest_angular_distance(from_angle, to_angle)
    turns = turn, two_pi_complement(turn)
    if begins_inside:
        for one in turns:
            if lower <= one <= upper:
                return True, one
        # The end is outside: go to the limit that is nearer to it.
        _, lower, upper = _find_min_max_delta(to_angle, left_limit, right_limit)
        lower, upper = upper, lower
    if fabs(lower) < fabs(upper):
        return False, min(turns)
    if fabs(lower) > fabs(upper):
        return False, max(turns)
    return False, turns[0] if fabs(turns[0]) < fabs(turns[1]) else turns[1]


def shortest_angular_distance_with_large_limits(
    from_angle: float, to_angle: float, left_limit: float, right_limit: float
) -> tuple[bool, float]:
    """Return whether a turn stays within limits that may be beyond -pi and pi, and the turn."""
    turn = shortest_angular_distance(from_angle, to_angle)
    turns = sorted((turn, two_pi_complement(turn)), key=fabs)
    if left_limit <= right_limit:
        for one in turns:
            if left_limit <= from_angle + one <= right_limit:
                return left_limit <= from_angle <= right_limit, one
    return False, turns[0]


def _find_min_max_delta(from_angle, left_limit, right_limit) -> tuple[bool, float, float]:
    """Return whether an angle is within limits, and the turns from it to both of them."""
    left = shortest_angular_distance(from_angle, left_limit)
    right = shortest_angular_distance(from_angle, right_limit)
    left_back, right_back = two_pi_complement(left), two_pi_complement(right)
    if left == 0:
        return True, left, max(right, right_back)
    if right == 0:
        return True, min(left, left_back), right
    lower, other_lower = min(left, left_back), max(left, left_back)
    upper, other_upper = max(right, right_back), min(right, right_back)
    if lower <= other_upper or upper >= other_lower:
        return left_limit == -pi and right_limit == pi, other_upper, other_lower
    return True, lower, upper
