var e=`# Recording of ROS 2 (MCAP) → canonical flight log. Keys of a row: see px4-ulog.toml; \`from\` names a type ("nav_msgs/Odometry:field") or a
# topic ("/drone1/odom:field"), fields as in the definition of the message.
# Of several topics of one type, the fastest that spans the recording is used; topics = ["/drone2/", "/vio/odom"] at the top of a mapping prefers
# topics whose names begin so.
# Units and frames: REP-103 and REP-145 (world east-north-up, body forward-left-up) for nav_msgs, sensor_msgs, geometry_msgs; PX4's message
# definitions (north-east-down, forward-right-down) for px4_msgs. \`world_velocity\` and \`discharge\` are derived while reading: an odometry's
# twist is in the body frame, and a battery's current is negative while it discharges.

source = "ros2"
base = ["px4_msgs/VehicleAngularVelocity", "px4_msgs/SensorCombined", "sensor_msgs/Imu", "px4_msgs/VehicleOdometry", "nav_msgs/Odometry"]

[[column]]
to = "rates"
from = "px4_msgs/VehicleAngularVelocity:xyz[]"
unit = "rad/s"

[[column]]
to = "rates"
from = "px4_msgs/SensorCombined:gyro_rad[]"
unit = "rad/s"

[[column]]
to = "rates"
from = "sensor_msgs/Imu:angular_velocity.x,angular_velocity.y,angular_velocity.z"
unit = "rad/s"
frame = "flu"

[[column]]
to = "rates"
from = "px4_msgs/VehicleOdometry:angular_velocity[]"
unit = "rad/s"

[[column]] # before 1.14
to = "rates"
from = "px4_msgs/VehicleOdometry:rollspeed,pitchspeed,yawspeed"
unit = "rad/s"

[[column]]
to = "rates"
from = "nav_msgs/Odometry:twist.twist.angular.x,twist.twist.angular.y,twist.twist.angular.z"
unit = "rad/s"
frame = "flu"

[[column]]
to = "accel"
from = "px4_msgs/SensorCombined:accelerometer_m_s2[]"
unit = "m/s2"

[[column]]
to = "accel"
from = "px4_msgs/VehicleAcceleration:xyz[]"
unit = "m/s2"

[[column]]
to = "accel"
from = "sensor_msgs/Imu:linear_acceleration.x,linear_acceleration.y,linear_acceleration.z"
unit = "m/s2"
frame = "flu"

[[column]]
to = "quaternion"
from = "px4_msgs/VehicleAttitude:q[]"
frame = "ned-frd"

[[column]]
to = "quaternion"
from = "px4_msgs/VehicleOdometry:q[]"
frame = "ned-frd"

[[column]]
to = "quaternion"
from = "nav_msgs/Odometry:pose.pose.orientation.w,pose.pose.orientation.x,pose.pose.orientation.y,pose.pose.orientation.z"
frame = "enu-flu"

[[column]]
to = "quaternion"
from = "geometry_msgs/PoseStamped:pose.orientation.w,pose.orientation.x,pose.orientation.y,pose.orientation.z"
frame = "enu-flu"

[[column]]
to = "quaternion"
from = "geometry_msgs/PoseWithCovarianceStamped:pose.pose.orientation.w,pose.pose.orientation.x,pose.pose.orientation.y,pose.pose.orientation.z"
frame = "enu-flu"

[[column]] # motion capture
to = "quaternion"
from = "geometry_msgs/TransformStamped:transform.rotation.w,transform.rotation.x,transform.rotation.y,transform.rotation.z"
frame = "enu-flu"

[[column]]
to = "quaternion"
from = "sensor_msgs/Imu:orientation.w,orientation.x,orientation.y,orientation.z"
frame = "enu-flu"

[[column]]
to = "position"
from = "px4_msgs/VehicleLocalPosition:x,y,z"
unit = "m"
valid = "xy_valid"

[[column]]
to = "position"
from = "px4_msgs/VehicleOdometry:position[]"
unit = "m"

[[column]] # before 1.14
to = "position"
from = "px4_msgs/VehicleOdometry:x,y,z"
unit = "m"

[[column]]
to = "position"
from = "nav_msgs/Odometry:pose.pose.position.x,pose.pose.position.y,pose.pose.position.z"
unit = "m"
frame = "enu"

[[column]]
to = "position"
from = "geometry_msgs/PoseStamped:pose.position.x,pose.position.y,pose.position.z"
unit = "m"
frame = "enu"

[[column]]
to = "position"
from = "geometry_msgs/PoseWithCovarianceStamped:pose.pose.position.x,pose.pose.position.y,pose.pose.position.z"
unit = "m"
frame = "enu"

[[column]] # motion capture
to = "position"
from = "geometry_msgs/TransformStamped:transform.translation.x,transform.translation.y,transform.translation.z"
unit = "m"
frame = "enu"

[[column]]
to = "position"
from = "sensor_msgs/NavSatFix:latitude,longitude,altitude"
frame = "geodetic"

[[column]]
to = "velocity"
from = "px4_msgs/VehicleLocalPosition:vx,vy,vz"
unit = "m/s"
valid = "v_xy_valid"

[[column]]
to = "velocity"
from = "px4_msgs/VehicleOdometry:world_velocity.x,world_velocity.y,world_velocity.z"
unit = "m/s"

[[column]]
to = "velocity"
from = "nav_msgs/Odometry:world_velocity.x,world_velocity.y,world_velocity.z"
unit = "m/s"
frame = "enu"

[[column]]
to = "velocity"
from = "geometry_msgs/TwistStamped:twist.linear.x,twist.linear.y,twist.linear.z"
unit = "m/s"
frame = "enu"

[[column]]
to = "velocity"
from = "geometry_msgs/TwistWithCovarianceStamped:twist.twist.linear.x,twist.twist.linear.y,twist.twist.linear.z"
unit = "m/s"
frame = "enu"

[[column]]
to = "height_above_ground_m"
from = "px4_msgs/VehicleLocalPosition:dist_bottom"
unit = "m"
valid = "dist_bottom_valid"

[[column]]
to = "height_above_ground_m"
from = "sensor_msgs/Range:range"
unit = "m"

[[column]]
to = "duty"
from = "px4_msgs/ActuatorMotors:control[]"

[[column]] # pulse widths of the outputs
to = "duty"
from = "px4_msgs/ActuatorOutputs:output[]"
low = 1000.0
high = 2000.0

[[column]] # pulse widths of the outputs
to = "duty"
from = "mavros_msgs/RCOut:channels[]"
low = 1000.0
high = 2000.0

[[column]]
to = "duty"
from = "actuator_msgs/Actuators:normalized[]"

[[column]]
to = "duty"
from = "mav_msgs/Actuators:normalized[]"

[[column]]
to = "rotor_speed"
from = "px4_msgs/EscStatus:esc[].esc_rpm"
unit = "rpm"

[[column]]
to = "rotor_speed"
from = "mavros_msgs/ESCStatus:esc_status[].rpm"
unit = "rpm"

[[column]]
to = "rotor_speed"
from = "mavros_msgs/ESCTelemetry:esc_telemetry[].rpm"
unit = "rpm"

[[column]]
to = "battery_voltage_v"
from = "px4_msgs/BatteryStatus:voltage_v"
unit = "V"

[[column]]
to = "battery_voltage_v"
from = "sensor_msgs/BatteryState:voltage"
unit = "V"

[[column]]
to = "battery_current_a"
from = "px4_msgs/BatteryStatus:current_a"
unit = "A"

[[column]]
to = "battery_current_a"
from = "sensor_msgs/BatteryState:discharge"
unit = "A"

[[column]]
to = "reference_position"
from = "px4_msgs/TrajectorySetpoint:position[]"
unit = "m"

[[column]]
to = "reference_yaw_rad"
from = "px4_msgs/TrajectorySetpoint:yaw"
unit = "rad"
`;export{e as default};