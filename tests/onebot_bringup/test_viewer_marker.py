"""Markers: what Rerun shows of each type, of actions, of lifetimes and of frames."""

import numpy as np
import pytest
from builtin_interfaces.msg import Duration
from geometry_msgs.msg import Point, Vector3
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from onebot_bringup.viewer.displays.marker import MarkerDrawing
from onebot_bringup.viewer.view_config import parse_view
from onebot_description.ros.wire.messages import time_message
from tests.onebot_bringup import viewer_support as support
from tests.onebot_bringup.drive_support import chunks, column, stamps
from tests.onebot_bringup.viewer_support import (
    START_NS,
    box,
    stamped,
    take,
    take_tf,
    transforms,
)

ONE, ARRAY = MarkerDrawing.message_types
SECOND = 10**9
SQUARE = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 1.0, 0.0)]
RED, GREEN, HALF_BLUE = (1.0, 0.0, 0.0, 1.0), (0.0, 1.0, 0.0, 1.0), (0.0, 0.0, 1.0, 0.5)


def marker(kind=Marker.CUBE, number=0, at=(0.0, 0.0, 0.0), frame="base", **fields) -> Marker:
    """A marker of half a meter, red; ``points`` and ``colors`` as tuples."""
    message = stamped(Marker(type=kind, id=number), frame=frame)
    message.pose.position.x, message.pose.position.y, message.pose.position.z = map(float, at)
    message.pose.orientation.w = 1.0
    make = {
        "points": lambda value: [Point(x=x, y=y, z=z) for x, y, z in value],
        "colors": lambda value: [_color(each) for each in value],
        "color": _color,
        "scale": lambda value: Vector3(x=value[0], y=value[1], z=value[2]),
        "lifetime": lambda value: Duration(sec=int(value), nanosec=int(value % 1 * SECOND)),
    }
    for name, value in ({"scale": (0.5, 0.5, 0.5), "color": RED} | fields).items():
        if name == "turn":
            turn = message.pose.orientation
            turn.x, turn.y, turn.z, turn.w = value
        else:
            setattr(message, name, make.get(name, lambda value: value)(value))
    return message


def _color(values) -> ColorRGBA:
    return ColorRGBA(**dict(zip("rgba", values, strict=True)))


class Shown(support.Shown):
    """A view with a robot and the topics /marks (arrays) and /mark, and its file."""

    def __init__(self, tmp_path, view="", **options):
        super().__init__(tmp_path, view, **options)
        self.view.offer({"/marks": ARRAY, "/mark": ONE})

    def send(self, *markers, at=START_NS):
        """Publish an array, and return what the user is told."""
        take(self.view, "/marks", MarkerArray(markers=list(markers)), at)
        return self.view.tick(at)

    def spaces(self):
        """The namespaces of which something is drawn of /mark."""
        displays = self.view.message_displays
        [drawing] = [each.items["/mark"] for each in displays if each.draws is MarkerDrawing]
        return {space for space, _ in drawing._where}  # noqa: SLF001


def rows(file, layer, name, topic="marks"):
    """All rows of a column of a layer."""
    return column(file, f"/marker/{topic}/{layer}", name)


def times(file, layer, topic="marks"):
    """Nanoseconds after the start, of each row of a layer."""
    return [stamp - START_NS for stamp in stamps(file, f"/marker/{topic}/{layer}")]


def flat(value):
    """All numbers of a row."""
    return np.array(value, float).ravel().tolist()


def test_cubes_of_a_namespace_are_one_row(tmp_path):
    """Where they are, how large, and in their colors, in their frame."""
    shown = Shown(tmp_path)
    half = np.sqrt(0.5)
    first = marker(ns="a", at=(1, 2, 3), scale=(1.0, 2.0, 3.0), turn=(0.0, 0.0, half, half))
    assert shown.send(first, marker(number=1, ns="a", color=HALF_BLUE), marker(ns="b")) == []
    file = shown.end()
    assert flat(rows(file, "a/cubes", "InstancePoses3D:translations")) == [1, 2, 3, 0, 0, 0]
    turns = flat(rows(file, "a/cubes", "InstancePoses3D:quaternions"))
    np.testing.assert_allclose(turns, [0, 0, half, half, 0, 0, 0, 1], atol=1e-6)
    assert flat(rows(file, "a/cubes", "InstancePoses3D:scales")) == [1, 2, 3, 0.5, 0.5, 0.5]
    assert flat(rows(file, "a/cubes", "Boxes3D:half_sizes")) == [0.5] * 3
    assert rows(file, "a/cubes", "Boxes3D:colors") == [[0xFF0000FF, 0x0000FF80]]
    assert rows(file, "a/cubes", "CoordinateFrame:frame") == [["base"]]
    assert times(file, "a/cubes") == [0]
    assert len(rows(file, "b/cubes", "Boxes3D:colors")[0]) == 1


@pytest.mark.parametrize(
    ("kind", "fields", "layer", "expected"),
    [
        (Marker.SPHERE, {}, "spheres", {"Ellipsoids3D:colors": [0xFF0000FF]}),
        (
            Marker.CYLINDER,
            {},
            "cylinders",
            {"Cylinders3D:radii": [0.5], "Cylinders3D:lengths": [1]},
        ),
        (
            Marker.ARROW,
            {"scale": (2.0, 0.2, 0.2), "turn": (0.0, 0.0, 1.0, 0.0)},
            "arrows",
            {
                "Arrows3D:vectors": [-2, 0, 0],
                "Arrows3D:origins": [1, 0, 0],
                "Arrows3D:radii": [0.1],
            },
        ),
        (
            Marker.ARROW,
            {"points": SQUARE[1:], "scale": (0.2, 0.4, 0.0)},
            "arrow_strips",
            {"Arrows3D:vectors": [0, 1, 0], "Arrows3D:origins": [2, 0, 0], "Arrows3D:radii": [0.1]},
        ),
        (
            Marker.ARROW_STRIP,
            {"points": SQUARE},
            "arrow_strips",
            {"Arrows3D:vectors": [1, 0, 0, 0, 1, 0], "Arrows3D:origins": [1, 0, 0, 2, 0, 0]},
        ),
        (
            Marker.LINE_STRIP,
            {"points": SQUARE, "scale": (0.1, 0.0, 0.0)},
            "lines",
            {"LineStrips3D:strips": [1, 0, 0, 2, 0, 0, 2, 1, 0], "LineStrips3D:radii": [0.05]},
        ),
        (
            Marker.LINE_STRIP,
            {"points": SQUARE, "colors": [RED, GREEN, GREEN]},
            "lines",
            {
                "LineStrips3D:strips": [1, 0, 0, 2, 0, 0, 2, 0, 0, 2, 1, 0],
                "LineStrips3D:colors": [0x808000FF, 0x00FF00FF],
            },
        ),
        (
            Marker.LINE_LIST,
            {"points": SQUARE, "turn": (0.0, 0.0, 1.0, 0.0)},
            "lines",
            {"LineStrips3D:strips": [1, 0, 0, 0, 0, 0], "LineStrips3D:colors": [0xFF0000FF]},
        ),
        (
            Marker.CUBE_LIST,
            {"points": SQUARE[1:], "colors": [RED, GREEN]},
            "cube_lists",
            {
                "InstancePoses3D:translations": [2, 0, 0, 2, 1, 0],
                "InstancePoses3D:scales": [0.5] * 6,
                "Boxes3D:colors": [0xFF0000FF, 0x00FF00FF],
            },
        ),
        (
            Marker.SPHERE_LIST,
            {"points": SQUARE[1:], "color": GREEN},
            "sphere_lists",
            {"Points3D:positions": [2, 0, 0, 2, 1, 0], "Points3D:radii": [0.25] * 2},
        ),
        (
            Marker.POINTS,
            {"points": SQUARE[1:], "scale": (0.5, 0.5, 0.0), "colors": [RED, HALF_BLUE]},
            "points",
            {"Points3D:radii": [0.25] * 2, "Points3D:colors": [0xFF0000FF, 0x0000FF80]},
        ),
        (
            Marker.TEXT_VIEW_FACING,
            {"text": "dock", "scale": (0.0, 0.0, 0.3)},
            "texts",
            {"Points3D:positions": [1, 0, 0], "Points3D:colors": [0xFF0000FF]},
        ),
        (
            Marker.TRIANGLE_LIST,
            {"points": [*SQUARE, *SQUARE], "colors": [RED, HALF_BLUE], "scale": (2.0, 1.0, 1.0)},
            "triangles",
            {
                "Mesh3D:vertex_positions": [1, 0, 0, 3, 0, 0, 3, 1, 0] * 2,
                "Mesh3D:vertex_colors": [0xFF0000FF] * 3 + [0x0000FFFF] * 3,
            },
        ),
        (
            Marker.TRIANGLE_LIST,
            {"points": SQUARE, "color": HALF_BLUE},
            "triangles",
            {"Mesh3D:vertex_colors": [0x0000FFFF] * 3, "Mesh3D:albedo_factor": [0xFFFFFF80]},
        ),
    ],
)
def test_each_type_is_drawn(tmp_path, kind, fields, layer, expected):
    """At its pose, one meter ahead, with its points, colors and scale."""
    shown = Shown(tmp_path)
    assert shown.send(marker(kind, at=(1, 0, 0), **fields)) == []
    file = shown.end()
    for name, numbers in expected.items():
        [row] = rows(file, layer, name)
        found = np.concatenate([flat(each) for each in row]) if "strips" in name else flat(row)
        np.testing.assert_allclose(found, numbers, atol=1e-6, err_msg=name)
    if kind == Marker.TEXT_VIEW_FACING:
        assert rows(file, layer, "Points3D:labels") == [["dock"]]


def test_lists_of_several_markers_lie_on_one_entity(tmp_path):
    """Each with its own pose and color, those without points too."""
    shown = Shown(tmp_path)
    strip = marker(Marker.LINE_STRIP, 1, points=SQUARE, at=(0, 0, 1))
    pairs = marker(Marker.LINE_LIST, 2, points=[*SQUARE, *SQUARE[:1]], color=GREEN)
    shown.send(marker(Marker.LINE_STRIP, 0, points=[]), strip, pairs)
    shown.send(*(marker(Marker.POINTS, k, points=SQUARE[:k], at=(k, 0, 0)) for k in range(3)))
    file = shown.end()
    [lines] = rows(file, "lines", "LineStrips3D:strips")
    assert [len(line) for line in lines] == [3, 2, 2]
    assert [line[0][2] for line in lines] == [1, 0, 0]
    colors = rows(file, "lines", "LineStrips3D:colors")
    assert colors == [[0xFF0000FF, 0x00FF00FF, 0x00FF00FF]]
    places = rows(file, "points", "Points3D:positions")
    assert flat(places) == [1, 0, 0, 2, 0, 0, 3, 0, 0]


def test_a_mesh_is_loaded_once_for_all_of_a_color(tmp_path):
    """In the marker's color, or its own if the marker says so; one that is not there is said."""
    box().export(tmp_path / "box.stl")
    uri = f"file://{tmp_path / 'box.stl'}"
    shown = Shown(tmp_path)
    meshes = [marker(Marker.MESH_RESOURCE, k, at=(k, 0, 0), mesh_resource=uri) for k in range(3)]
    meshes[2].color.g = 1.0
    own = marker(Marker.MESH_RESOURCE, 3, mesh_resource=uri, mesh_use_embedded_materials=True)
    gone = marker(Marker.MESH_RESOURCE, 4, mesh_resource=f"{uri}.dae")
    [said] = shown.send(*meshes, own, gone)
    assert said.startswith('marker "/marks": id 4 of "":') and "box.stl.dae" in said
    meshes[0].pose.position.y = 1.0
    shown.send(*meshes, own, gone, at=START_NS + 1)
    file = shown.end()
    first, second = rows(file, "meshes", "InstancePoses3D:translations")
    assert (flat(first), flat(second)) == ([0, 0, 0, 1, 0, 0], [0, 1, 0, 1, 0, 0])
    assert sum(bool(blob) for blob in rows(file, "meshes", "Asset3D:blob")) == 1
    factors = [flat(rows(file, f"meshes{n}", "Asset3D:albedo_factor")) for n in ("", "_2", "_3")]
    assert factors == [[0xFF0000FF], [0xFFFF00FF], [0xFFFFFFFF]]


def test_what_has_not_changed_is_not_logged_again(tmp_path):
    """The same markers again cost no row; moved ones a row of their places."""
    shown = Shown(tmp_path)
    for at in range(3):
        shown.send(*(marker(number=k, at=(k, 0, 0)) for k in range(5)), at=START_NS + at)
    shown.send(*(marker(number=k, at=(k, 1, 0)) for k in range(5)), at=START_NS + 3)
    shown.send(marker(number=2, at=(2, 2, 0)), at=START_NS + 4)
    file = shown.end()
    assert times(file, "cubes") == [0, 3, 4]
    assert len(list(filter(None, rows(file, "cubes", "Boxes3D:colors")))) == 1
    last = rows(file, "cubes", "InstancePoses3D:translations")[-1]
    assert [place[1] for place in last] == [1, 1, 2, 1, 1]


def test_what_is_sent_once_is_logged_again(tmp_path, monkeypatch):
    """A server with a memory limit drops the oldest data."""
    monkeypatch.setattr("onebot_bringup.viewer.core.rerun_limits.REPEAT_AFTER", -1.0)
    shown = Shown(tmp_path)
    shown.send(marker())
    for tick in range(3):
        shown.view.tick(START_NS + tick * SECOND)
    file = shown.end()
    assert len(rows(file, "cubes", "Boxes3D:colors")) >= 4
    assert set(times(file, "cubes")) == {0}


def _logged(file, layer, name, topic="marks"):
    """The values of a column of a layer, each with its nanoseconds after the start."""
    batches = (chunk.to_record_batch() for chunk in chunks(file, f"/marker/{topic}/{layer}"))
    return [
        (at - START_NS, value)
        for batch in batches
        if name in batch.schema.names
        for at, value in zip(
            batch.column("ros_time").cast("int64").to_pylist(),
            batch.column(name).to_pylist(),
            strict=True,
        )
        if value is not None
    ]


def _cleared(file, layer, topic="marks"):
    """When a layer was emptied, seconds after the start."""
    return [at / SECOND for at, _ in _logged(file, layer, "Clear:is_recursive", topic)]


def test_a_marker_disappears_when_its_lifetime_is_over(tmp_path):
    """At that time, also if nothing more comes; one that comes again in time stays."""
    shown = Shown(tmp_path)
    shown.send(
        marker(lifetime=1.0), marker(Marker.SPHERE, 1, lifetime=0.25), marker(Marker.ARROW, 2)
    )
    shown.view.tick(START_NS + SECOND // 2)
    shown.send(marker(lifetime=1.0), at=START_NS + SECOND * 3 // 4)
    shown.view.tick(START_NS + 5 * SECOND)
    file = shown.end()
    assert _cleared(file, "cubes") == [1.75]
    assert _cleared(file, "spheres") == [0.25]
    assert _cleared(file, "arrows") == []


@pytest.mark.parametrize(
    "came",
    [
        {0.1: 0.0, 1.1: 0.5, 2.1: 1.9, 3.1: 2.5},
        {0.1: -60.0, 0.2: 0.2, 1.1: 1.1},
        {0.1: 5.1, 0.5: 0.5, 1.1: 6.1, 1.3: 1.3},
    ],
    ids=["takes more or less long", "is latched", "is of a clock ahead"],
)
def test_a_lifetime_is_as_long_whenever_a_marker_was_stamped(tmp_path, came):
    """As in RViz, it counts from when the marker comes, in seconds of ``came``: to its stamp."""
    shown, seen, tick = Shown(tmp_path), dict.fromkeys(came, 0), SECOND // 20
    for now in range(0, 4 * SECOND, tick):
        for at, stamp in came.items():
            if round(at * SECOND) == now:
                single = marker(ns=str(at), lifetime=0.5)
                single.header.stamp = time_message(START_NS + round(stamp * SECOND))
                take(shown.view, "/mark", single, START_NS + now)
        shown.view.tick(START_NS + now)
        for space in shown.spaces():
            seen[float(space)] += 1
    assert all(10 <= ticks <= 11 for ticks in seen.values()), seen
    shown.end()


def test_lifetimes_begin_anew_where_the_clock_is_set_back(tmp_path):
    """What was of the time before ends with it; from then on they are as long as ever."""
    shown = Shown(tmp_path)

    def send(space, seconds, lifetime):
        single = marker(ns=space, lifetime=lifetime)
        single.header.stamp = time_message(START_NS + round(seconds * SECOND))
        take(shown.view, "/mark", single, START_NS + round(seconds * SECOND))

    def tick(seconds):
        shown.view.tick(START_NS + round(seconds * SECOND))
        return shown.spaces()

    send("old", 100.0, 50.0)
    assert tick(100.0) == tick(100.5) == {"old"}
    send("late", 100.6, 0.5)
    send("new", 20.0, 1.0)
    assert tick(20.0) == tick(20.4) == {"late", "new"}
    assert tick(20.9) == {"new"}
    assert tick(21.1) == set()
    assert _cleared(shown.end(), "old/cubes", "mark") == [150.0]


def test_single_markers_that_come_together_are_one_row(tmp_path):
    """But not those of a later time, which are rows of their own."""
    shown = Shown(tmp_path)
    for number in range(50):
        take(shown.view, "/mark", marker(number=number, at=(number, 0, 0)))
    moved = marker(number=3, at=(0, 1, 0))
    moved.header.stamp = time_message(START_NS + SECOND)
    take(shown.view, "/mark", moved, START_NS + SECOND)
    shown.view.tick(START_NS + SECOND)
    file = shown.end()
    first, second = rows(file, "cubes", "InstancePoses3D:translations", "mark")
    assert (len(first), first[3][1], second[3][1]) == (50, 0, 1)
    assert times(file, "cubes", "mark") == [0, SECOND]


def test_a_marker_moves_with_its_frame_only_if_it_is_locked(tmp_path):
    """Else it stays where it was in the fixed frame."""
    shown = Shown(tmp_path, "fixed_frame: base")
    free, locked = marker(frame="tip", at=(0, 1, 0)), marker(number=1, frame="/tip")
    locked.frame_locked = True
    shown.send(free, locked)
    for at, y in ((1, 0.7), (2, 0.9)):
        take_tf(shown.view, transforms("base", "tip", y, START_NS + at))
        free.header.stamp = time_message(START_NS + at)
        shown.send(*[free] * (at == 2), locked, at=START_NS + at)
    file = shown.end()
    assert rows(file, "cubes", "CoordinateFrame:frame") == [["base"]]
    places = rows(file, "cubes", "InstancePoses3D:translations")
    np.testing.assert_allclose(flat(places), [0, 1.5, 0, 0, 1.9, 0], atol=1e-6)
    assert rows(file, "cubes_2", "CoordinateFrame:frame") == [["tip"]]
    assert flat(rows(file, "cubes_2", "InstancePoses3D:translations")) == [0, 0, 0]


@pytest.mark.parametrize("topic", ["marks", "mark"])
def test_a_marker_is_placed_where_its_frame_was_at_its_own_stamp(tmp_path, topic):
    """Each of those that come together; without a stamp where the frame is when it comes."""
    shown = Shown(tmp_path, "fixed_frame: base")
    for tenth in range(11):
        at = START_NS + tenth * SECOND // 10
        take_tf(shown.view, transforms("base", "tip", tenth / 10, at))
    everything = [marker(number=k, frame="tip") for k in range(4)]
    for each, part in zip(everything, (0.5, 0.52, 0.5, 0.5), strict=True):
        each.header.stamp = time_message(START_NS + int(part * SECOND))
    everything[2].header.stamp = time_message(0)
    if topic == "marks":
        take(shown.view, "/marks", MarkerArray(markers=everything), START_NS + SECOND)
    else:
        for each in everything:
            take(shown.view, "/mark", each, START_NS + SECOND)
    shown.view.tick(START_NS + SECOND)
    found = rows(shown.end(), "cubes", "InstancePoses3D:translations", topic)[-1]
    assert [y for _, y, _ in found] == pytest.approx([0.5, 0.52, 1.0, 0.5])


def test_a_marker_in_an_unknown_frame_waits_and_is_warned_of(tmp_path):
    """The others do not; it is drawn as it came last, one that is deleted meanwhile not at all."""
    now = [0.0]
    shown = Shown(tmp_path, clock=lambda: now[0])
    for x in (1.0, 2.0, 3.0):
        far = [marker(number=k, frame="map", at=(x, 0, 0)) for k in (1, 2)]
        assert shown.send(*far, marker(number=0)) == []
    shown.send(marker(number=2, action=Marker.DELETE))
    now[0] = 4.0
    [said] = shown.view.tick(START_NS)
    assert 'marker "/marks" is in the frame "map"' in said
    take_tf(shown.view, transforms("map", "base", 0.0), static=True)
    shown.view.tick(START_NS + SECOND)
    file = shown.end()
    drawn = [rows(file, name, "CoordinateFrame:frame") for name in ("cubes", "cubes_2")]
    assert drawn == [[["base"]], [["map"]]]
    assert flat(rows(file, "cubes_2", "InstancePoses3D:translations")) == [3, 0, 0]


def test_namespaces_may_be_hidden(tmp_path):
    """By the view, as RViz's check boxes do."""
    shown = Shown(tmp_path, "marker: {topics: {/marks: {hidden_namespaces: [noise]}}}")
    shown.send(marker(ns="noise"), marker(ns="goals"))
    shown.view.set_view(parse_view("marker: {hidden_namespaces: [goals]}"))
    file = shown.end()
    drawn = {
        space: len(list(filter(None, rows(file, f"{space}/cubes", "Boxes3D:colors"))))
        for space in ("noise", "goals")
    }
    assert drawn == {"noise": 1, "goals": 1}
    assert rows(file, "goals/cubes", "Clear:is_recursive") == [[False]]


@pytest.mark.parametrize(
    ("kind", "fields", "drawn", "said"),
    [
        (Marker.CUBE, {"at": (np.nan, 0, 0)}, 0, "not finite: not drawn"),
        (Marker.CUBE, {"scale": (1e300, 1.0, 1.0)}, 0, "not finite: not drawn"),
        (Marker.CUBE, {"scale": (0.0, 1.0, 1.0)}, 1, "its scale is zero"),
        (Marker.CUBE, {"turn": (0.0, 0.0, 0.0, 2.0)}, 1, "is not of unit length"),
        (Marker.CUBE, {"color": (1.0, 1.0, 1.0, 0.0)}, 1, "it is transparent"),
        (Marker.CUBE, {"frame": ""}, 0, "it names no frame"),
        (Marker.LINE_STRIP, {"points": SQUARE, "colors": [RED]}, 1, "fewer colors than points"),
        (99, {}, 0, "its type is unknown"),
        (Marker.POINTS, {"points": []}, 0, "fewer than 1 points: not drawn"),
        (Marker.POINTS, {"points": [(np.inf, 0.0, 0.0)]}, 0, "its points are not finite"),
        (Marker.MESH_RESOURCE, {"mesh_resource": ""}, 0, "mesh"),
    ],
)
def test_what_is_wrong_is_said_once(tmp_path, kind, fields, drawn, said):
    """With the first marker that has it; the others are drawn."""
    shown = Shown(tmp_path)
    wrong = [marker(kind, k, **{"ns": "w"} | fields) for k in (4, 5)]
    [sentence] = shown.send(*wrong, marker(Marker.SPHERE, ns="good"))
    assert sentence.startswith('marker "/marks": id 4 of "w": ') and said in sentence
    assert shown.send(*wrong) == []
    file = shown.end()
    [turn] = rows(file, "good/spheres", "InstancePoses3D:quaternions")
    assert turn == [[0, 0, 0, 1]]
    layers = ("cubes", "points", "lines", "meshes")
    assert sum(bool(chunks(file, f"/marker/marks/w/{name}")) for name in layers) == drawn
    for turns in rows(file, "w/cubes", "InstancePoses3D:quaternions"):
        np.testing.assert_allclose(turns, [[0, 0, 0, 1]] * 2)


def _model(state, markers):
    """What RViz has after an array: type and x by namespace and number."""
    for each in markers:
        if each.action == Marker.DELETEALL:
            gone = [key for key in state if each.ns in ("", key[0])]
        else:
            gone = [(each.ns, each.id)]
        for key in gone:
            state.pop(key, None)
        if each.action == Marker.ADD:
            state[each.ns, each.id] = each.type, each.pose.position.x


@pytest.mark.parametrize("seed", range(2))
def test_any_sequence_of_arrays_ends_as_in_rviz(tmp_path, seed):
    """Of many adds, changes of type and deletions: the last rows have what a simple model has."""
    random = np.random.default_rng(seed)
    shown, state = Shown(tmp_path), {}
    for step in range(60):
        if step % 3 or step == 0:
            markers = [
                marker(
                    int(random.choice([Marker.CUBE, Marker.SPHERE])),
                    int(random.integers(4)),
                    (step + k / 16, 0, 0),
                    ns=str(random.choice(["a", "b"])),
                    action=int(random.choice([0, 2, 3], p=[0.8, 0.15, 0.05])),
                )
                for k in range(random.integers(1, 8))
            ]
        _model(state, markers)
        shown.send(*markers, at=START_NS + step)
    file = shown.end()
    for space in "ab":
        for kind, layer in ((Marker.CUBE, "cubes"), (Marker.SPHERE, "spheres")):
            cleared = _logged(file, f"{space}/{layer}", "Clear:is_recursive")
            events = [(at, []) for at, _ in cleared]
            events += _logged(file, f"{space}/{layer}", "InstancePoses3D:translations")
            last = max(events, default=(0, []), key=lambda event: event[0])[1]
            expected = [x for (of, _), (which, x) in state.items() if (of, which) == (space, kind)]
            assert sorted(place[0] for place in last) == sorted(expected)
