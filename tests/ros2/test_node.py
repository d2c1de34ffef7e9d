"""The node against a stand-in for rclpy: topics, parameters, types of messages."""

from __future__ import annotations

import importlib.util
import sys
import xml.etree.ElementTree as ET
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest
import yaml

from asyneio.ros2.parameters import parameter_defaults
from asyneio.ros2.poses import PosesInOdom, transform_of
from tests.ros2.messages import empty, frozen
from tests.ros2.test_poses import estimate

pytestmark = pytest.mark.slow

PACKAGE = Path(__file__).parents[2] / "ros2" / "asyneio_ros"
NODE = PACKAGE / "asyneio_ros" / "node.py"
_TYPES = {
    "diagnostic_msgs.msg": ("DiagnosticArray", "DiagnosticStatus", "KeyValue"),
    "geometry_msgs.msg": ("TransformStamped",),
    "nav_msgs.msg": ("Odometry",),
    "sensor_msgs.msg": ("Imu",),
}


class FakeNode:
    """What the node uses of rclpy's Node; parameters come from `given`."""

    given: dict[str, Any] = {}  # noqa: RUF012

    def __init__(self, name: str) -> None:
        self.name = name
        self.parameters: dict[str, Any] = {}
        self.published: dict[str, list[Any]] = {}
        self.subscribed: dict[str, tuple[Any, Any]] = {}

    def declare_parameter(self, name: str, default: Any, descriptor: Any) -> None:
        assert descriptor.dynamic_typing
        self.parameters[name] = self.given.get(name, default)

    def get_parameter(self, name: str) -> SimpleNamespace:
        return SimpleNamespace(value=self.parameters[name])

    def create_publisher(self, kind: Any, topic: str, depth: int) -> SimpleNamespace:
        self.published[topic] = []
        return SimpleNamespace(publish=self.published[topic].append)

    def create_subscription(self, kind: Any, topic: str, callback: Any, qos: Any, *, raw: bool) -> None:
        assert raw
        self.subscribed[topic] = (kind, callback)

    def create_timer(self, period_s: float, callback: Any) -> None:
        self.timer = callback

    def get_clock(self) -> SimpleNamespace:
        return SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=17 * 10**17))

    def get_logger(self) -> SimpleNamespace:
        return SimpleNamespace(info=lambda text: None)

    def destroy_node(self) -> None:
        """Nothing to release."""


@pytest.fixture
def node(monkeypatch: pytest.MonkeyPatch, parameters: dict[str, object]) -> Any:
    """The running node."""
    sent: list[Any] = []
    contents: dict[str, dict[str, Any]] = {
        "rclpy": {},
        "rclpy.executors": {"ExternalShutdownException": type("ExternalShutdownException", (Exception,), {})},
        "rclpy.node": {"Node": FakeNode},
        "rclpy.qos": {
            "HistoryPolicy": SimpleNamespace(KEEP_LAST=1),
            "ReliabilityPolicy": SimpleNamespace(BEST_EFFORT=2),
            "QoSProfile": SimpleNamespace,
        },
        "rcl_interfaces.msg": {"ParameterDescriptor": SimpleNamespace},
        "rosidl_runtime_py.utilities": {"get_message": lambda name: name},
        "tf2_ros": {"TransformBroadcaster": lambda node: SimpleNamespace(sendTransform=sent.append)},
    }
    for module, names in _TYPES.items():
        package = module.split(".")[0]
        contents[module] = {name: _maker(f"{package}/msg/{name}") for name in names}
    for name, content in contents.items():
        fake = ModuleType(name)
        vars(fake).update(content)
        monkeypatch.setitem(sys.modules, name, fake)
    monkeypatch.setattr(FakeNode, "given", parameters)
    spec = importlib.util.spec_from_file_location("asyneio_node_under_test", NODE)
    assert spec is not None
    assert spec.loader is not None
    module_of_node = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module_of_node)
    running = module_of_node.AsyneioNode()
    running.sent = sent
    yield running
    running.destroy_node()


def _maker(kind: str) -> Any:
    return lambda: empty(kind)


def test_topics_and_parameters(node: Any) -> None:
    assert set(node.subscribed) == {"events", "imu"}
    assert node.subscribed["events"][0] == "event_camera_msgs/msg/EventPacket"
    assert set(node.published) == {"odometry", "/diagnostics"}
    assert set(node.parameters) == set(parameter_defaults())


def test_what_the_node_publishes(node: Any, rng: Any) -> None:
    pose = PosesInOdom(transform_of([0.0] * 6 + [1.0])).convert(estimate(rng))
    node._publish(pose)
    node.timer()
    odometry = frozen("nav_msgs/msg/Odometry", node.published["odometry"][0])
    transform = frozen("geometry_msgs/msg/TransformStamped", node.sent[0])
    assert odometry.pose.pose.position.x == transform.transform.translation.x == pose.position[0]
    diagnostics = frozen("diagnostic_msgs/msg/DiagnosticArray", node.published["/diagnostics"][0])
    assert diagnostics.header.stamp.sec == 17 * 10**8
    assert diagnostics.status[0].level == 3


def test_the_node_is_a_shell() -> None:
    assert len(NODE.read_text(encoding="utf-8").splitlines()) <= 100


def test_the_parameter_file_has_known_names() -> None:
    content = yaml.safe_load((PACKAGE / "config" / "asyneio.yaml").read_text(encoding="utf-8"))
    names: set[str] = set()
    for name, value in content["asyneio"]["ros__parameters"].items():
        names |= {f"{name}.{key}" for key in value} if isinstance(value, dict) else {name}
    assert names <= set(parameter_defaults())


def test_the_package_declares_what_the_node_imports() -> None:
    """Every ROS package that the node imports is a dependency."""
    root = ET.parse(PACKAGE / "package.xml").getroot()
    declared = {element.text for element in root.iter("exec_depend")}
    lines = NODE.read_text(encoding="utf-8").splitlines()
    imported = {line.split()[1].split(".")[0] for line in lines if line.startswith(("from ", "import "))}
    assert imported - {"__future__", "asyneio"} <= declared
    for path in ("launch/odometry.launch.py", "config/asyneio.yaml", "resource/asyneio_ros"):
        assert (PACKAGE / path).is_file()
        assert path in (PACKAGE / "setup.py").read_text(encoding="utf-8")
