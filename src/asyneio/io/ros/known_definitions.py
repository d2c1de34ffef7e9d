# SPDX-License-Identifier: Apache-2.0
"""Message definitions for bags without them (SQLite before ROS 2 Iron, IDL), by type name."""

from __future__ import annotations

from asyneio.io.ros.bag import Topic
from asyneio.io.ros.schema import Schema, parse_schema, plain_name

_VECTOR = "MSG: geometry_msgs/{}\nfloat64 x\nfloat64 y\nfloat64 z\n"
_POINT, _VECTOR3 = _VECTOR.format("Point"), _VECTOR.format("Vector3")
_QUATERNION = "MSG: geometry_msgs/Quaternion\nfloat64 x\nfloat64 y\nfloat64 z\nfloat64 w\n"
_POSE = "MSG: geometry_msgs/Pose\nPoint position\nQuaternion orientation\n" + _POINT + _QUATERNION
_COVARIANT = "MSG: geometry_msgs/PoseWithCovariance\nPose pose\nfloat64[36] covariance\n" + _POSE

_EVENT_ARRAY = "Header header\nuint32 height\nuint32 width\nEvent[] events\nMSG: {}/Event\n"
_EVENT = "uint16 x\nuint16 y\nbuiltin_interfaces/Time ts\nbool polarity\n"
_PACKET = (
    "Header header\nuint32 height\nuint32 width\nuint64 seq\nuint64 time_base\nstring encoding\n"
    "bool is_bigendian\nuint8[] events\n"
)

DEFINITIONS = {
    "dvs_msgs/EventArray": _EVENT_ARRAY.format("dvs_msgs") + _EVENT,
    "dv_ros2_msgs/EventArray": _EVENT_ARRAY.format("dv_ros2_msgs") + _EVENT,
    "prophesee_event_msgs/EventArray": _EVENT_ARRAY.format("prophesee_event_msgs") + _EVENT,
    "event_camera_msgs/EventPacket": _PACKET,
    "event_array_msgs/EventArray": _PACKET,
    "sensor_msgs/Imu": (
        "Header header\ngeometry_msgs/Quaternion orientation\nfloat64[9] orientation_covariance\n"
        "geometry_msgs/Vector3 angular_velocity\nfloat64[9] angular_velocity_covariance\n"
        "geometry_msgs/Vector3 linear_acceleration\nfloat64[9] linear_acceleration_covariance\n"
    )
    + _QUATERNION
    + _VECTOR3,
    "geometry_msgs/PoseStamped": "Header header\nPose pose\n" + _POSE,
    "nav_msgs/Path": (
        "Header header\ngeometry_msgs/PoseStamped[] poses\n"
        "MSG: geometry_msgs/PoseStamped\nstd_msgs/Header header\nPose pose\n"
    )
    + _POSE,
    "geometry_msgs/PoseWithCovarianceStamped": "Header header\nPoseWithCovariance pose\n" + _COVARIANT,
    "geometry_msgs/TransformStamped": (
        "Header header\nstring child_frame_id\nTransform transform\n"
        "MSG: geometry_msgs/Transform\nVector3 translation\nQuaternion rotation\n"
    )
    + _VECTOR3
    + _QUATERNION,
    "nav_msgs/Odometry": (
        "Header header\nstring child_frame_id\ngeometry_msgs/PoseWithCovariance pose\n" + _COVARIANT
    ),
    "sensor_msgs/CameraInfo": (
        "Header header\nuint32 height\nuint32 width\nstring distortion_model\nfloat64[] d\nfloat64[9] k\n"
        "float64[9] r\nfloat64[12] p\n"
    ),
}


def schema_of(topic: Topic) -> Schema | None:
    """The definition of the messages of a topic: from the bag, else by type name; None if unknown.

    Raises:
        RecordingError: the definition in the bag is malformed.
    """
    definition = topic.definition or DEFINITIONS.get(plain_name(topic.type), "")
    return parse_schema(topic.type, definition) if definition else None
