//! Definitions of common messages of ROS 2, for recordings that hold none (rosbag2 before Iron).
//!
//! They have been the same in every release since Foxy; `sensor_msgs/Range` has another field at its end since Iron, from which on recordings
//! hold definitions. Messages of other packages (`px4_msgs`) change their fields from release to release and are not guessed.
//! (<https://github.com/ros2/common_interfaces>, <https://github.com/mavlink/mavros>, branch `ros2`)

use super::definition::plain_name;

/// Types that others are made of, and types of topics; each with its fields.
const MESSAGES: [(&str, &str); 24] = [
    ("builtin_interfaces/Time", "int32 sec\nuint32 nanosec\n"),
    ("std_msgs/Header", "builtin_interfaces/Time stamp\nstring frame_id\n"),
    ("geometry_msgs/Point", "float64 x\nfloat64 y\nfloat64 z\n"),
    ("geometry_msgs/Vector3", "float64 x\nfloat64 y\nfloat64 z\n"),
    (
        "geometry_msgs/Quaternion",
        "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n",
    ),
    (
        "geometry_msgs/Pose",
        "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n",
    ),
    (
        "geometry_msgs/Twist",
        "geometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular\n",
    ),
    (
        "geometry_msgs/Transform",
        "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n",
    ),
    (
        "geometry_msgs/PoseWithCovariance",
        "geometry_msgs/Pose pose\nfloat64[36] covariance\n",
    ),
    (
        "geometry_msgs/TwistWithCovariance",
        "geometry_msgs/Twist twist\nfloat64[36] covariance\n",
    ),
    (
        "geometry_msgs/PoseStamped",
        "std_msgs/Header header\ngeometry_msgs/Pose pose\n",
    ),
    (
        "geometry_msgs/PoseWithCovarianceStamped",
        "std_msgs/Header header\ngeometry_msgs/PoseWithCovariance pose\n",
    ),
    (
        "geometry_msgs/TransformStamped",
        "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform\n",
    ),
    (
        "geometry_msgs/TwistStamped",
        "std_msgs/Header header\ngeometry_msgs/Twist twist\n",
    ),
    (
        "geometry_msgs/TwistWithCovarianceStamped",
        "std_msgs/Header header\ngeometry_msgs/TwistWithCovariance twist\n",
    ),
    (
        "nav_msgs/Odometry",
        "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/PoseWithCovariance pose\ngeometry_msgs/TwistWithCovariance twist\n",
    ),
    (
        "sensor_msgs/Imu",
        "std_msgs/Header header\ngeometry_msgs/Quaternion orientation\nfloat64[9] orientation_covariance\n\
         geometry_msgs/Vector3 angular_velocity\nfloat64[9] angular_velocity_covariance\n\
         geometry_msgs/Vector3 linear_acceleration\nfloat64[9] linear_acceleration_covariance\n",
    ),
    (
        "sensor_msgs/BatteryState",
        "std_msgs/Header header\nfloat32 voltage\nfloat32 temperature\nfloat32 current\nfloat32 charge\nfloat32 capacity\n\
         float32 design_capacity\nfloat32 percentage\nuint8 power_supply_status\nuint8 power_supply_health\nuint8 power_supply_technology\n\
         bool present\nfloat32[] cell_voltage\nfloat32[] cell_temperature\nstring location\nstring serial_number\n",
    ),
    ("sensor_msgs/NavSatStatus", "int8 status\nuint16 service\n"),
    (
        "sensor_msgs/NavSatFix",
        "std_msgs/Header header\nsensor_msgs/NavSatStatus status\nfloat64 latitude\nfloat64 longitude\nfloat64 altitude\n\
         float64[9] position_covariance\nuint8 position_covariance_type\n",
    ),
    (
        "sensor_msgs/Range",
        "std_msgs/Header header\nuint8 radiation_type\nfloat32 field_of_view\nfloat32 min_range\nfloat32 max_range\nfloat32 range\n",
    ),
    ("mavros_msgs/RCOut", "std_msgs/Header header\nuint16[] channels\n"),
    (
        "actuator_msgs/Actuators",
        "std_msgs/Header header\nfloat64[] position\nfloat64[] velocity\nfloat64[] normalized\n",
    ),
    ("rosgraph_msgs/Clock", "builtin_interfaces/Time clock\n"),
];

/// The definition of a type with all that it is made of, as a recording would carry it; `None` for one that is not known.
pub(super) fn definition(kind: &str) -> Option<String> {
    let fields = |kind: &str| {
        MESSAGES
            .iter()
            .find(|(name, _)| *name == kind)
            .map(|(_, fields)| *fields)
    };
    let kind = plain_name(kind);
    let mut text = fields(&kind)?.to_owned();
    let mut parts: Vec<&str> = Vec::new();
    loop {
        let named = |line: &str| {
            line.split(' ')
                .next()
                .map(|kind| kind.trim_end_matches(']').split('[').next().unwrap_or("").to_owned())
        };
        let missing = text.lines().filter_map(named).find_map(|kind| {
            MESSAGES
                .iter()
                .find(|(name, _)| *name == kind)
                .filter(|(name, _)| !parts.contains(name))
        });
        let Some((name, fields)) = missing else {
            return Some(text);
        };
        parts.push(name);
        text += &format!("{}\nMSG: {name}\n{fields}", "=".repeat(80));
    }
}

#[cfg(test)]
mod tests {
    use super::super::definition::Definition;
    use super::*;

    #[test]
    fn val_every_known_message_is_whole() {
        for (kind, _) in MESSAGES {
            let text = definition(kind).unwrap_or_default();
            assert!(Definition::parse(kind, &text).is_ok(), "{kind}: {text}");
        }
        assert_eq!(definition("px4_msgs/msg/VehicleOdometry"), None);
    }
}
