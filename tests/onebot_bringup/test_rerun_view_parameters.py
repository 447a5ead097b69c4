"""The viewer's view, switched, edited and saved while it runs, over real DDS."""

from rcl_interfaces.srv import GetParameters
from rclpy.parameter import parameter_value_to_python
from std_msgs.msg import String
from std_srvs.srv import Trigger

from onebot_bringup.viewer.view_config import load_view
from tests.onebot_bringup.test_rerun_viewer import Robot
from tests.onebot_bringup.viewer_support import ARM, VIEW, viewer_node
from tests.ros_support import LATCHED, Peer
from tests.support import PATIENCE, wait_for

NODE = "/rerun_viewer"


def _saved_view(peer: Peer) -> Trigger.Response:
    client = peer.node.create_client(Trigger, f"{NODE}/save_view")
    assert client.wait_for_service(PATIENCE)
    future = client.call_async(Trigger.Request())
    wait_for(future.done, "the answer")
    return future.result()


def _value(peer: Peer, name: str) -> object:
    client = peer.node.create_client(GetParameters, f"{NODE}/get_parameters")
    assert client.wait_for_service(PATIENCE)
    future = client.call_async(GetParameters.Request(names=[name]))
    wait_for(future.done, "the answer")
    return parameter_value_to_python(future.result().values[0])


def test_a_switch_is_saved(ros_domain, tmp_path):
    """RViz's check boxes; what cannot be is refused with what would be right."""
    view = tmp_path / "view.yaml"
    with viewer_node(tmp_path, f"{VIEW}\ncollision: true\n"), Peer(ros_domain) as peer:
        [done] = peer.set_parameters(NODE, collision=False)
        assert done.successful
        [refused] = peer.set_parameters(NODE, **{"camera.eye": [1.0]})
        assert not refused.successful
        assert "camera.eye: 1 numbers; write three metres" in refused.reason
        [integers] = peer.set_parameters(NODE, **{"camera.eye": [4, 0, 0]})
        assert integers.successful
        answer = _saved_view(peer)
        assert answer.success and str(view) in answer.message
    saved = load_view(view)
    assert not saved.collision and saved.camera.eye == (4.0, 0.0, 0.0)


def test_an_edit_of_the_file_is_shown_and_a_mistake_is_said_once(ros_domain, tmp_path):
    """The last good view stays; the parameters follow; new topics are heard."""
    view = tmp_path / "view.yaml"
    with viewer_node(tmp_path) as node, Peer(ros_domain) as peer:
        Robot(peer)
        wait_for(lambda: 'showing "arm"' in node.output, "the robot")
        view.write_text(VIEW + "collision: maybe\n")
        wait_for(lambda: "keeping the view shown so far" in node.output, "the warning")
        assert _value(peer, "collision") is False
        view.write_text("".join(f"{' ' * level}a:\n" for level in range(3000)))
        wait_for(lambda: "nested more than 64 deep" in node.output, "the second warning")
        view.write_text(VIEW)
        wait_for(lambda: f"{view} is right again: it is in use" in node.output, "the mended file")
        assert "was edited" not in node.output
        view.write_text(VIEW + "collision: true\ntrails: {way: {topic: way}}\n")
        wait_for(lambda: "the view is up to date" in node.output, "the edit")
        assert _value(peer, "collision") is True
        wait_for(lambda: peer.node.count_subscribers("/way") == 1, "the new topic")
        view.write_text(VIEW + "trails: {way: {topic: other}}\n")
        wait_for(lambda: peer.node.count_subscribers("/other") == 1, "the other topic")
        wait_for(lambda: peer.node.count_subscribers("/way") == 0, "the end of the first")
        assert node.output.count("keeping the view") == 2


def test_the_robot_s_own_view_is_found_by_its_name(ros_domain, tmp_path):
    """Without view, MRM is looked at as its description says; with "none" it is not."""
    urdf = ARM.replace('name="arm"', 'name="mrm"')
    for view, limits in (("", True), ("none", False)):
        with viewer_node(tmp_path, None, **({"view": view} if view else {})) as node:
            with Peer(ros_domain) as peer:
                peer.publisher(String, "robot_description", LATCHED).publish(String(data=urdf))
                wait_for(lambda: 'showing "mrm"' in node.output, "the robot")  # noqa: B023
                if limits:
                    wait_for(lambda: "mrm_description/config/view.yaml" in node.output, "it")  # noqa: B023
                assert _value(peer, "joint_plot.limits") is limits


def test_a_parameter_given_at_the_start_goes_before_the_file(ros_domain, tmp_path):
    """But not the empty fixed_frame that a launch file passes on."""
    view = tmp_path / "view.yaml"
    with viewer_node(tmp_path, **{"axes.visible": True, "fixed_frame": '""'}) as node:
        with Peer(ros_domain) as peer:
            assert _value(peer, "axes.visible") is True
            assert _value(peer, "fixed_frame") == "base"
            assert list(_value(peer, "camera.eye")) == [2.6, 0.5, 0.0]
            answer = _saved_view(peer)
            assert answer.success and load_view(view).axes.visible
            assert node.process.poll() is None


def test_a_view_that_cannot_be_saved_says_why(ros_domain, tmp_path):
    """Without a file, until one is named."""
    with viewer_node(tmp_path, None, view="none") as node, Peer(ros_domain) as peer:
        answer = _saved_view(peer)
        assert not answer.success and "save_view_to" in answer.message
        results = peer.set_parameters(NODE, save_view_to=str(tmp_path / "new.yaml"), collision=True)
        assert all(result.successful for result in results)
        assert _saved_view(peer).success
        assert load_view(tmp_path / "new.yaml").collision
        assert "Traceback" not in node.output


def test_the_page_s_address_is_published(ros_domain, tmp_path):
    """Latched, once the page is up: it names the page and the recording's server."""
    with viewer_node(tmp_path, viewer="web") as node, Peer(ros_domain) as peer:
        heard = peer.hear(String, f"{NODE}/page", LATCHED)
        address = wait_for(lambda: heard and heard[-1].data, "the address")
        assert address.startswith("http://127.0.0.1:") and "url=rerun%2Bhttp" in address
        wait_for(lambda: "open http" in node.output, "the line that says it")
        assert f"open {address.partition('/?')[0]}" in node.output
        late = peer.hear(String, f"{NODE}/page", LATCHED)
        wait_for(lambda: late and late[-1].data == address, "the address, later on")
